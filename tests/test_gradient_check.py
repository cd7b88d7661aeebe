"""Tests that messages name each loss whose gradient reaches no stroke and each metric that is NaN."""

import math

import numpy as np
import pytest
import torch
from painters import fit, painter_of, take
from refusals import refuses

from brushexp.painting.metrics import measure
from brushexp.pictures.region import Region
from brushexp.plugins.loss.base import Loss
from brushexp.plugins.loss.curvature import Curvature
from brushexp.plugins.loss.mse import MeanSquaredError
from brushexp.plugins.metric.base import Metric
from brushexp.plugins.optimizer.torch import TorchOptim
from brushexp.plugins.sampler.base import Sampler, View
from brushexp.strokes.catalogue import Strokes


class Detached(Loss):
    def forward(self, view):
        return (view.image - view.target).square().mean().detach()


class Rounded(Loss):
    def forward(self, view):
        return 1 + (view.image - view.target).square().mean().round()


class Nobody(Sampler):
    def __call__(self, strokes, size, step, generator):
        return View(Region(0, 0, 8, 8), torch.empty(0, dtype=torch.long))


def test_a_loss_without_gradient_is_refused_before_the_first_step():
    painter = painter_of(n=5, steps=3, losses={"mine": Detached()})
    refuses(r"^loss=mine: no gradient reaches the strokes, so no stroke would move; .*\.detach\(\)", fit, painter)
    assert painter.schedule.step == 0


def test_one_of_several_losses_without_gradient_is_told_once(caplog):
    fit(painter_of(n=5, steps=3, losses={"mse": MeanSquaredError(), "mine": Detached()}))
    assert [record.getMessage() for record in caplog.records if "gradient" in record.getMessage()] == [
        "loss=mine has no effect, because its gradient reaches no stroke; "
        "compute it from view.image or view.strokes without .detach(), .item(), NumPy or comparisons"
    ]


def test_an_objective_with_no_slope_is_told(caplog):
    take(painter_of(n=5, losses={"flat": Rounded()}), 1)
    assert "loss=flat: the gradient is 0 for all strokes at the start" in caplog.text


@pytest.mark.parametrize("parts", [
    {"losses": {"mse": MeanSquaredError(), "curvature": Curvature()}},
    {"losses": {"mse": MeanSquaredError(), "curvature": Curvature()},
     "optimizer": TorchOptim(units={"color": 1.0, "opacity": 1.0})},  # dots, whose shapes stay fixed
    {"losses": {"mse": MeanSquaredError()}, "strokes": Strokes.none()},
    {"losses": {"mse": MeanSquaredError()}, "sampler": Nobody()},
])  # fmt: skip
def test_nothing_is_said_where_all_is_well_or_nothing_could_move(caplog, parts):
    take(painter_of(n=5, **parts), 1)
    assert "gradient" not in caplog.text


class Undefined(Metric):
    title, higher_is_better = "undefined", True

    def __call__(self, comparison):
        return math.nan


class Unknown(Metric):
    title, higher_is_better = "unknown", True

    def __call__(self, comparison):
        return None


def test_a_metric_that_is_no_number_is_told_once_by_its_name(caplog):
    grey = np.zeros((4, 6, 3), np.uint8)
    numbers = measure({"undefined": Undefined(), "unknown": Unknown()}, grey, grey)
    assert math.isnan(numbers["undefined"])
    assert numbers["unknown"] is None
    (record,) = caplog.records
    assert record.getMessage() == ("metric=undefined is not a number (NaN) for this painting; metrics.json has null")
