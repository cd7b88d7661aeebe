"""Metrics against their definitions; which are measured, and how they are shown."""

import math

import numpy as np
import pytest
import torch
from networks import saved, state_of
from torchmetrics.functional.image import structural_similarity_index_measure

from brushexp import registry
from brushexp.painting.metrics import measure, metrics_of, official_lpips, standard_metrics
from brushexp.plugins.metric.base import STANDARD, Metric
from brushexp.registry import register
from brushexp.results.quantities import quantities

A, B = np.random.default_rng(0).integers(0, 256, (2, 40, 33, 3), dtype=np.uint8)


def test_standard_metrics_are_what_they_are_defined_as():
    measured = measure(standard_metrics(), A, B)
    a, b = A / 255, B / 255
    slopes = [np.abs(np.diff(a - b, axis=axis)).ravel() for axis in (0, 1)]
    similarity = structural_similarity_index_measure(
        *(torch.tensor(x).permute(2, 0, 1)[None] for x in (a, b)), data_range=1.0
    )
    assert measured["psnr"] == pytest.approx(-10 * math.log10(((a - b) ** 2).mean()), abs=1e-4)
    assert measured["ssim"] == pytest.approx(float(similarity), abs=1e-6)
    assert measured["l1"] == pytest.approx(np.abs(a - b).mean())
    assert measured["edges"] == pytest.approx(np.concatenate(slopes).mean())
    assert list(measured) == ["psnr", "ssim", "l1", "edges", "perceptual", "perceptual_backbone"]
    pixel = measure(standard_metrics(), A[:1, :1], A[:1, :1])
    assert (pixel["psnr"], pixel["ssim"], pixel["edges"]) == (math.inf, None, None)


def test_the_official_distance_is_measured_if_there_is_a_file(tmp_path):
    official = official_lpips("alexnet", str(saved(tmp_path, state_of("alexnet"))))
    measured = measure(standard_metrics() | official, A, B)
    display = [torch.tensor(x).permute(2, 0, 1) / 255 for x in (A, B)]
    assert measured["lpips_alexnet"] == pytest.approx(float(official["lpips"].distance(*display)))
    assert measured == measure(standard_metrics(), A, B) | {"lpips_alexnet": measured["lpips_alexnet"]}


def test_the_chosen_metrics_are_measured_and_psnr_in_any_case(config):
    assert list(metrics_of(config())) == list(STANDARD)
    assert list(metrics_of(config("metric=[l1]"))) == ["psnr", "l1"]


@pytest.mark.usefixtures("hydra_restore_singletons")
def test_tables_and_pages_show_a_metric_as_its_class_says(monkeypatch):
    monkeypatch.setattr(registry, "_plugins", dict(registry._plugins))

    @register("metric", "tint")
    class Tint(Metric):
        """Difference of the mean colours."""

        title, unit, digits, higher_is_better = "tint", "levels", 1, False

        def __call__(self, comparison):
            return 255 * float((comparison.image - comparison.target).mean().abs())

    display = quantities()["tint"]
    assert (display.name, display.digits, display.better, display.about) == (
        "tint, levels", 1, "lower", "Difference of the mean colours.",
    )  # fmt: skip
    assert list(quantities())[: len(STANDARD)] == list(STANDARD)
    assert list(quantities()).index("tint") < list(quantities()).index("seconds")
