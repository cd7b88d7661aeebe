"""Bits of strokes: rounding changes a painting little, packing loses nothing, and more strokes take more."""

import lzma
from dataclasses import replace

import numpy as np
import torch
from brushexp_studies.analysis.bits import LEVELS, OPACITIES, PLACES, WIDENINGS, BitsPerPixel, packed, quantised
from scenes import random_strokes, with_shapes

from brushexp.painting.picture import Picture
from brushexp.pictures.similarity import psnr_of
from brushexp.plugins.blend.tiled import Tiled
from brushexp.plugins.metric.base import Comparison
from brushexp.plugins.renderer.analytic import Analytic
from brushexp.strokes.bezier import strokes_along
from brushexp.strokes.catalogue import Strokes

CANVAS = (64, 96)


def restored(numbers: np.ndarray) -> Strokes:
    """Make strokes again of what `quantised` has rounded."""
    values = torch.from_numpy(numbers).float()
    points = values[:, :6].reshape(-1, 3, 2) / PLACES
    points = torch.cat([points[:, :1], points[:, :1] + points[:, 1:]], dim=1)
    strokes = strokes_along(points, values[:, 6] / PLACES, values[:, 8:11] / LEVELS, values[:, 11] / OPACITIES)
    rest = {"widening": values[:, 12] / WIDENINGS, "drift": values[:, 13:] / LEVELS}
    return replace(strokes, softness=values[:, 7] / PLACES / strokes.scale, **rest)


def drawn(strokes):
    painter = Picture(torch.zeros(3, *CANVAS), None, torch.zeros(3), Tiled(opaque=0))
    painter.renderer = Analytic()
    return painter.draw(strokes, torch.arange(len(strokes)))


def test_packing_loses_nothing_seen_and_more_strokes_take_more_bits_and_equal_ones_few():
    strokes = with_shapes(random_strokes(60, CANVAS))
    difference = drawn(strokes) - drawn(restored(quantised(strokes)))
    assert psnr_of(float(difference.square().mean())) > 40
    numbers = quantised(random_strokes(60, CANVAS))
    bytes_ = np.frombuffer(lzma.decompress(packed(numbers)), np.uint8).reshape(16, 2, -1)
    assert (numbers == bytes_.transpose(0, 2, 1).copy().view("<i2")[..., 0].T).all()
    picture = torch.zeros(3, *CANVAS)
    few, many = (BitsPerPixel()(Comparison(picture, picture, None, random_strokes(n, CANVAS))) for n in (50, 500))
    assert 5 < many / few < 12
    alike = Strokes.join(*[random_strokes(1, CANVAS)] * 500)
    assert BitsPerPixel()(Comparison(picture, picture, None, alike)) < 0.2 * many
    assert BitsPerPixel()(Comparison(picture, picture, None, Strokes.none())) < few
