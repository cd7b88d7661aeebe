"""Make subjects and canvases for the benchmark's paintings."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

Array = NDArray[Any]

FIELDS = 7  # number of fields of a subject
GAMUT = 42.0  # maximum a and b of its colours in CIELAB; larger values leave sRGB
WASH_BLUR = 40  # standard deviation in pixels of the blur that turns a subject into a wash


def make_subject(side: int, random: np.random.Generator) -> Array:
    """Make a subject (side, side, 3) of smoothly varying colour fields with edges between them."""
    from skimage.color import lab2rgb  # noqa: PLC0415  (slow to import)

    def noise(sigma: float) -> Array:
        values = gaussian_filter(random.normal(size=(side, side)), sigma * side, mode="wrap")
        return values / values.std()

    bend = np.stack([noise(0.08), noise(0.08)], -1) * 0.04 * side
    rows, columns = np.mgrid[:side, :side]
    centres = random.random((FIELDS, 2)) * side
    places = np.stack([rows, columns], -1) + bend
    field = ((places[:, :, None] - centres) ** 2).sum(-1).argmin(-1)
    lab = np.stack([random.uniform(25, 85, FIELDS), *random.normal(0, 26, (2, FIELDS))], -1)[field]
    lab = lab + np.stack([9 * noise(0.05), 7 * noise(0.07), 7 * noise(0.07)], -1)
    lab = lab.clip([15, -GAMUT, -GAMUT], [92, GAMUT, GAMUT])
    return np.clip(lab2rgb(lab), 0, 1)


def prime_canvas(subject: Array, random: np.random.Generator) -> Array:
    """Prime a canvas (H, W, 3) in a random colour, with a faint wash of the subject and some grain."""
    bare = random.uniform(0.35, 0.9, 3) if random.random() < 0.7 else np.full(3, random.uniform(0.5, 0.95))
    wash = gaussian_filter(subject, (WASH_BLUR, WASH_BLUR, 0))
    grain = gaussian_filter(random.normal(size=subject.shape[:2]), 2)
    return np.clip((0.75 * bare + 0.25 * wash) * (1 + 0.02 * (grain / grain.std())[..., None]), 0, 1)
