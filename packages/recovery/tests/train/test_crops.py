"""Test that crops are rotated together with their ground truth, and that losses have correct gradients."""

import numpy as np
import pytest
import torch
from brushexp_recovery.model.channels import CENTRE, CENTRE_UNIT, CHANNELS, DIRECTION, StrokeAttribute
from brushexp_recovery.synthesis.canvas import StrokeGeometry
from brushexp_recovery.train.crops import Crop, batch_of, cut_crop, turn_and_mirror
from brushexp_recovery.train.losses import losses_of
from recovery_scenes import bars


@pytest.mark.parametrize("seed", range(6))
def test_turned_crops_point_to_the_centre_of_their_stroke(seed):
    painting = bars(0.7)
    labels = painting.labels[:, 12:108].astype(np.int64)
    labels[labels == 0] = -1  # the upper stroke is wholly visible
    geometry = painting.geometry.copy()
    geometry[:, StrokeGeometry.CENTRE_X] -= 12
    crop = turn_and_mirror(np.zeros((96, 96, 3), np.float32), labels, geometry, np.random.default_rng(seed))
    rows, columns = np.nonzero(crop.labels == 1)
    own, place = crop.attributes[:, rows, columns], np.stack([columns + 0.5, rows + 0.5])
    centre = place + CENTRE_UNIT * own[CENTRE]
    np.testing.assert_allclose(centre, np.repeat(place.mean(1)[:, None], len(rows), 1), atol=1)
    xx, yy, xy = columns.var(), rows.var(), np.cov(columns, rows)[0, 1]
    shape = np.array([xx - yy, 2 * xy]) / np.hypot(xx - yy, 2 * xy)
    np.testing.assert_allclose(own[DIRECTION].mean(1), shape, atol=0.02)


@pytest.mark.parametrize("seed", range(4))
def test_strokes_in_a_crop_are_as_wide_as_they_are_said_to_be(seed):
    crop = cut_crop(bars(0.0), np.random.default_rng(seed), 96)
    assert crop.image.shape == (3, 96, 96)
    assert (crop.image >= 0).all()
    upper = crop.labels == 1
    log_width = crop.attributes[StrokeAttribute.LOG_WIDTH][upper]
    assert np.ptp(log_width) == 0
    across = min(np.median(lines[lines > 0]) for lines in (upper.sum(0), upper.sum(1)))
    assert across == pytest.approx(np.exp(log_width[0]), rel=0.15)


def test_crops_become_a_batch():
    crops = [cut_crop(bars(), np.random.default_rng(seed), 64) for seed in range(2)]
    batch = batch_of(crops)
    for name in Crop._fields:
        np.testing.assert_array_equal(getattr(batch, name)[1].numpy(), getattr(crops[1], name))


def test_losses_have_the_gradients_of_their_values():
    labels = torch.tensor([[[0, 0, 1, 1], [0, -1, 1, 2], [2, 2, 2, 2], [0, 0, 2, 1]]]).repeat(2, 6, 6)
    attributes = torch.randn(2, len(StrokeAttribute), 24, 24).double().sigmoid()
    maps = torch.randn(2, CHANNELS, 24, 24).double()
    way = torch.randn_like(maps)
    loss = lambda t: sum(losses_of(maps + t * way, labels, attributes).values())  # noqa: E731
    t = torch.zeros((), dtype=torch.float64, requires_grad=True)
    (slope,) = torch.autograd.grad(loss(t), t)
    torch.testing.assert_close(slope, (loss(t + 1e-6) - loss(t - 1e-6)) / 2e-6, rtol=1e-5, atol=1e-7)
