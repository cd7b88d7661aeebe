"""Sum moments over the pixels of each region, so that the moments of merged regions can be added."""

from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp_recovery.model.channels import CENTRE_UNIT, StrokeAttribute
from brushexp_recovery.model.logistic import sigmoid
from brushexp_recovery.segment.affinity_maps import StrokeMaps

Array = NDArray[Any]


class Moment(IntEnum):
    """Sums over the pixels of a region; dividing them by the area gives means."""

    AREA = 0  # pixels
    X = 1  # pixels from the left
    Y = 2
    XX = 3  # squares and product of the coordinates
    XY = 4
    YY = 5
    LIGHTNESS = 6  # lightness in CIELAB
    A = 7
    B = 8
    LIGHTNESS_SQUARED = 9
    A_SQUARED = 10
    B_SQUARED = 11
    CENTRE_X = 12  # predicted centre of the stroke in pixels
    CENTRE_Y = 13
    CENTRE_SQUARED = 14  # squared distance of the centre from the picture's corner
    COSINE = 15  # cosine of twice the predicted direction
    SINE = 16
    LOG_WIDTH = 17  # predicted logarithm of pixels
    LOG_LENGTH = 18
    VISIBLE = 19  # predicted share of the stroke that is visible
    PAINT = 20  # predicted chance that the pixel is paint
    LOG_WIDTH_SQUARED = 21
    LOG_LENGTH_SQUARED = 22


LAB = slice(Moment.LIGHTNESS, Moment.B + 1)
LAB_SQUARED = slice(Moment.LIGHTNESS_SQUARED, Moment.B_SQUARED + 1)
MIDDLE = slice(Moment.X, Moment.Y + 1)
PREDICTED_CENTRE = slice(Moment.CENTRE_X, Moment.CENTRE_Y + 1)
PREDICTED_DIRECTION = slice(Moment.COSINE, Moment.SINE + 1)


def sum_moments(labels: Array, image: Array, maps: StrokeMaps) -> Array:
    """Sum the moments (S, len(Moment)) of the S regions in a label image (H, W) of a picture (H, W, 3) in [0, 1]."""
    from skimage.color import rgb2lab  # noqa: PLC0415

    height, width = labels.shape
    y, x = np.mgrid[:height, :width] + 0.5
    lightness, a, b = rgb2lab(image).transpose(2, 0, 1)
    attributes = maps.attributes
    centre_x = x + CENTRE_UNIT * attributes[StrokeAttribute.CENTRE_X]
    centre_y = y + CENTRE_UNIT * attributes[StrokeAttribute.CENTRE_Y]
    log_width = attributes[StrokeAttribute.LOG_WIDTH]
    log_length = attributes[StrokeAttribute.LOG_LENGTH]
    values = {
        Moment.AREA: np.ones((height, width)),
        Moment.X: x,
        Moment.Y: y,
        Moment.XX: x * x,
        Moment.XY: x * y,
        Moment.YY: y * y,
        Moment.LIGHTNESS: lightness,
        Moment.A: a,
        Moment.B: b,
        Moment.LIGHTNESS_SQUARED: lightness**2,
        Moment.A_SQUARED: a**2,
        Moment.B_SQUARED: b**2,
        Moment.CENTRE_X: centre_x,
        Moment.CENTRE_Y: centre_y,
        Moment.CENTRE_SQUARED: centre_x * centre_x + centre_y * centre_y,
        Moment.COSINE: attributes[StrokeAttribute.COSINE],
        Moment.SINE: attributes[StrokeAttribute.SINE],
        Moment.LOG_WIDTH: log_width,
        Moment.LOG_LENGTH: log_length,
        Moment.VISIBLE: sigmoid(attributes[StrokeAttribute.VISIBLE]),
        Moment.PAINT: sigmoid(maps.paint),
        Moment.LOG_WIDTH_SQUARED: log_width**2,
        Moment.LOG_LENGTH_SQUARED: log_length**2,
    }
    flat, count = labels.ravel(), int(labels.max()) + 1
    return np.stack([np.bincount(flat, values[moment].ravel(), minlength=count) for moment in Moment], 1)
