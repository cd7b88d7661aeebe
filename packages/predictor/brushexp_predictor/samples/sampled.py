"""Measure a picture's brushwork, with intervals derived from several paintings: ``brushexp.sample_brushwork``."""

import logging
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from os import PathLike
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from omegaconf import DictConfig
from torch import Tensor

from brushexp.contracts.files import find_path, showing
from brushexp.contracts.pictures import load_picture
from brushexp.contracts.runs import settings_of, undisturbed
from brushexp_predictor.lay.network import PREDICTORS, SHIPPED_NAME, load_predictor
from brushexp_predictor.lay.predicting import TEMPERATURE, Sample, paint_samples
from brushexp_predictor.samples.conformal import Scalings, read_scalings, summarise_samples
from brushexp_predictor.samples.coverage import KINDS, lattice, measure_at
from brushexp_predictor.samples.kinds import PAINTING_KINDS, measure_painting

Array = NDArray[Any]
Show = Callable[[float, str], None]

CELLS = 64  # number of places along the longer side at which the strokes of samples are compared
AREA = 100  # pixels per stroke if the number of strokes is not given
SAMPLED_SIDE = 512  # longer side in pixels

log = logging.getLogger(__name__)


class Interval(NamedTuple):
    """A measure and its interval, as numbers or arrays; NaN = unknown; a direction's ends may be outside [0, 180)."""

    value: Any
    low: Any
    high: Any


@dataclass(frozen=True)
class SampledBrushwork:
    """Brushwork of a picture, estimated from several paintings of it."""

    picture: Tensor  # (3, H, W)
    samples: list[Sample]
    measures: Mapping[str, Interval]  # measures `kinds.PAINTING_KINDS` of the whole picture
    places: Tensor  # (rows, columns, 2: x, y) pixels
    strokes: Mapping[str, Interval]  # (rows, columns), of the visible stroke at each place: direction, length, width
    is_calibrated: bool  # whether intervals are calibrated on known paintings or only derived from the samples


def sample_brushwork(
    image: Any,
    *,
    samples: int = 32,
    strokes: int | None = None,
    resolution: int | None = SAMPLED_SIDE,
    checkpoint: str | PathLike[str] = SHIPPED_NAME,
    intervals: str | PathLike[str] | None = None,
    temperature: float = TEMPERATURE,
    seed: int = 0,
) -> SampledBrushwork:
    """Paint a picture many times with a network, and measure its brushwork with intervals, as ``task=sample`` does.

    Args:
        image: path, name of a sample, or picture as an (H, W, 3) or (3, H, W) tensor, uint8 or floats in [0, 1].
        samples: number of paintings, at least two.
        strokes: approximate number of strokes in the picture; None = one per 100 pixels.
        resolution: longer side in pixels to which the picture is resampled; None = unchanged.
        checkpoint: weights: a .safetensors file, or the name of shipped weights.
        intervals: file written by task=calibrate; None = the file next to the weights.
        temperature: variation in strokes between samples, in units of the deviations that the network predicts.
        seed: random seed for this variation.

    Raises:
        UserError: the picture, the weights, the intervals or another argument is invalid.
    """
    settings = settings_of("sample", locals())  # includes the picture
    with undisturbed():
        return sample_with(settings.cfg)


def sample_with(cfg: DictConfig) -> SampledBrushwork:
    """Sample brushwork as `sample_brushwork` does, given the checked keys of ``task=sample``."""
    picture = load_picture(cfg.image, cfg.resolution)
    scalings = scalings_for(cfg.checkpoint, cfg.intervals, cfg.temperature)
    if scalings is None:
        log.warning("intervals are not calibrated, hence too narrow: fit them with brushexp calibrate keep=true")
    network = load_predictor(cfg.checkpoint)
    n = cfg.strokes or max(1, round(picture[0].numel() / AREA))
    with showing("painting samples") as show:
        painted = []
        for sample in paint_samples(network, picture, n, cfg.samples, cfg.seed, cfg.temperature):
            painted.append(sample)
            show(len(painted) / cfg.samples, f"painting {len(painted)} of {cfg.samples}, {sample.psnr:.2f} dB")
    return brushwork_of(picture, painted, n, scalings)


def scalings_for(checkpoint: str, intervals: str | None, temperature: float) -> Scalings | None:
    """Read the scalings fitted for given weights; return None if no file is named and none is next to the weights."""
    weights = PREDICTORS.path_of(checkpoint)
    path = weights.with_suffix(".intervals.json") if intervals is None else find_path(intervals)
    if intervals is None and not path.is_file():
        return None
    needs = {"hash": PREDICTORS.read_recipe(weights)["hash"], "temperature": temperature}
    return read_scalings(path, needs, KINDS)


def brushwork_of(picture: Tensor, samples: list[Sample], n: int, scalings: Scalings | None) -> SampledBrushwork:
    """Measure the brushwork of a picture (3, H, W) from samples with ``n`` strokes each."""
    size = (picture.shape[1], picture.shape[2])
    pitch, places = math.sqrt(size[0] * size[1] / n), lattice(size, max(size) / CELLS)
    told = measure_at([sample.strokes for sample in samples], places.flatten(0, 1))
    whole = [measure_painting(sample.strokes, size) for sample in samples]

    def interval(of: str, name: str, values: Array) -> Interval:
        kind = KINDS[of, name]
        doubt = summarise_samples(kind.inner(values, pitch), kind.axial)
        doubt = doubt if scalings is None else scalings[of, name](doubt, kind)
        ends = (doubt.middle, doubt.middle + doubt.low, doubt.middle + doubt.high)
        return Interval(*(kind.outer(value, pitch) for value in ends))

    measures = {name: interval("paintings", name, np.array([one[name] for one in whole])) for name in PAINTING_KINDS}
    shape = (len(samples), *places.shape[:2])
    strokes = {name: interval("strokes", name, values.reshape(shape)) for name, values in told.items()}
    return SampledBrushwork(picture, samples, measures, places, strokes, scalings is not None)
