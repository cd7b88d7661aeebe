"""Measure a renderer's errors on held-out strokes, its speed, and its behaviour outside the training range."""

import time
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple

import torch
from torch import Tensor

from brushexp.contracts.families import Blend, Engine, Renderer, window_pictures
from brushexp.contracts.files import with_progress
from brushexp.contracts.strokes import clamp_to_prior, parameters_of, sample_prior, strokes_of
from brushexp_training.evaluation.evaluation import (
    FeatureDistance,
    bristle_figures,
    bristle_sums,
    error_figures,
    error_sums,
    squared_error,
)
from brushexp_training.stroke_sets.datamodule import StrokeBatch

ACROSS, DOWN = 16, 8  # columns and rows of strokes painted at once while timing
REPETITIONS, TIMING_SECONDS = 7, 6.0  # maximum number of repetitions, and time in seconds after which none begins
# A stroke in the middle of the training range; each extreme stroke differs from it in one respect.
ORDINARY = {"start": (-0.5, 0.25), "control": (0.05, 0.0), "end": (0.5, 0.2), "width": 0.1, "color": (0.2, 0.45, 0.75)}
EXTREMES: dict[str, dict[str, object]] = {
    "ordinary": {},
    **{f"width {width:g}": {"width": width} for width in (0.0, 0.01, 0.03, 0.2, 0.5, 1.0)},
    "length 0": {"start": (0.1, 0.1), "control": (0.1, 0.1), "end": (0.1, 0.1)},
    "length 0.02": {"start": (0.09, 0.1), "control": (0.1, 0.1), "end": (0.11, 0.1)},
    "length 2.8": {"start": (-1.0, -1.0), "control": (0.0, 0.0), "end": (1.0, 1.0)},
    **{f"control at {place}": {"control": (0.0, -float(place))} for place in (1, 2, 5)},
    "ends at 1.5": {"start": (-1.5, 0.25), "end": (1.5, 0.2)},
    **{f"red {red}": {"color": (red, 0.45, 0.75)} for red in (-0.5, 1.5)},
}  # lengths and positions in half-windows, widths in sides of the window


def evaluate(
    renderer: Renderer, batches: Iterable[StrokeBatch], n: int, window: int, distances: Sequence[FeatureDistance]
) -> dict[str, float]:
    """Compute `error_figures`, `bristle_figures` and the given feature distances on ``n`` held-out strokes."""
    sums, bristles = torch.zeros(5, dtype=torch.float64), torch.zeros(2, 2, 2, dtype=torch.float64)
    for batch in with_progress(batches, n, "evaluating strokes", lambda batch: len(batch.number)):
        drawn, truth = draw_batch(renderer, batch, window)
        sums += error_sums(drawn, truth)
        bristles += bristle_sums(drawn, truth, batch.parameters.to(drawn.device))
        for distance in distances:
            distance.add(drawn, truth)
    figures = error_figures(sums) | bristle_figures(bristles)
    for distance in distances:
        figures |= distance.figures()
    return figures


@torch.no_grad()
def draw_batch(renderer: Renderer, batch: StrokeBatch, window: int) -> tuple[Tensor, Tensor]:
    """Draw the pictures (B, 4, S, S) of a batch, clamped to [0, 1], and return them with the true pictures."""
    device = device_of_weights(renderer)
    drawn = window_pictures(renderer, batch.parameters.to(device), window, batch.number.to(device))
    return drawn.clamp(0, 1), batch.images.to(device)


def strokes_per_second(renderer: Renderer, blend: Blend, window: int, *, backward: bool) -> float:
    """Measure the painting speed in strokes per second, as the best of several repetitions.

    The strokes are painted in adjacent windows. With ``backward``, the time includes the computation of gradients.
    """
    device, n = device_of_weights(renderer), ACROSS * DOWN
    strokes = sample_prior(n)
    place = torch.stack(torch.meshgrid(torch.arange(ACROSS), torch.arange(DOWN), indexing="xy"), dim=-1).reshape(-1, 2)
    scale = torch.full_like(strokes.scale, window)
    strokes = replace(strokes, position=window * (place + 0.5), scale=scale).map(lambda value: value.to(device))
    white, order = torch.ones(3, device=device), torch.arange(n, device=device)
    seconds: list[float] = []
    while len(seconds) <= REPETITIONS and (len(seconds) < 2 or sum(seconds) <= TIMING_SECONDS):
        leaves = strokes.map(lambda value: value.clone().requires_grad_(backward))
        before = time.perf_counter()
        with torch.set_grad_enabled(backward):
            image = blend(renderer(leaves), order, (DOWN * window, ACROSS * window), white).image
            if backward:
                image.sum().backward()
        if device.type == "cuda":
            torch.cuda.synchronize(device)
        seconds.append(time.perf_counter() - before)
    return n / min(seconds[1:])


class ExtremeDrawings(NamedTuple):
    """Drawings of the strokes in `EXTREMES`.

    In ``pictures``, the key "painted" holds the pictures as users see them. For networks with the option ``project``,
    the key "bare" holds pictures drawn without projection.
    """

    nearest: Tensor  # (n, 4, S, S), the engine's pictures of the nearest strokes in the training range
    pictures: dict[str, Tensor]
    rows: list[dict[str, object]]  # rows of `outside.csv`; ``alpha_mass`` and ``l2`` are relative to the nearest


@torch.no_grad()
def draw_extremes(renderer: Renderer, engine: Engine, seed: int) -> ExtremeDrawings:
    """Draw the strokes in `EXTREMES` with the renderer, and compare them with the engine's pictures.

    The engine draws the nearest strokes in the training range; ``seed`` determines its brushes.
    """
    chosen = [{**ORDINARY, **changes} for changes in EXTREMES.values()]
    values = {name: torch.tensor([stroke[name] for stroke in chosen]) for name in ORDINARY}
    side, strokes = engine.window, replace(strokes_of(torch.zeros(len(chosen), 10)), **values)
    within = clamp_to_prior(replace(strokes, color=strokes.color.clamp(0, 1)))
    nearest = engine(parameters_of(within), seed=seed).images
    parameters = parameters_of(strokes).to(device_of_weights(renderer))
    pictures = {"painted": window_pictures(renderer, parameters, side).cpu()}
    if getattr(renderer, "project", False):
        renderer.project = False  # type: ignore[assignment]
        pictures["bare"] = window_pictures(renderer, parameters, side).cpu()
        renderer.project = True  # type: ignore[assignment]
    rows = [
        {
            "stroke": name,
            "drawn": kind,
            "finite": bool(image.isfinite().all()),
            "in_range": bool(((image >= 0) & (image <= 1)).all()),
            "alpha_mass": float(image[3].sum() / truth[3].sum()),
            "l2": float(squared_error(image, truth)),
        }
        for kind, images in pictures.items()
        for name, image, truth in zip(EXTREMES, images, nearest, strict=True)
    ]
    return ExtremeDrawings(nearest, pictures, rows)


def speed_and_size(renderer: Renderer, blend: Blend, window: int) -> dict[str, float]:
    """Measure the speed with and without gradients (see `strokes_per_second`), and count the weights."""
    return {
        "strokes_per_second": strokes_per_second(renderer, blend, window, backward=False),
        "strokes_per_second_backward": strokes_per_second(renderer, blend, window, backward=True),
        "parameters": sum(parameter.numel() for parameter in renderer.parameters()),
    }


def device_of_weights(renderer: Renderer) -> torch.device:
    """Return the device of a renderer's weights, or the CPU if it has none."""
    return next((weight.device for weight in renderer.parameters()), torch.device("cpu"))
