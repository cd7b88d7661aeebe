"""Mistakes a config can hold that Hydra accepts in silence."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any

from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from brushexp.errors import UserError
from brushexp.registry import MULTI_SELECT, plugins


@dataclass
class Shared:
    """Types of the keys that every task has; their values are in conf/config.yaml."""

    task: str
    seed: int
    device: str
    threads: int | None
    output: str


@dataclass
class Paint(Shared):
    """Types of the keys of ``task=paint``; values and meaning are in conf/task/paint.yaml."""

    image: str
    resolution: int | None
    strokes: int | None
    pixels_per_stroke: float
    steps: int
    steps_per_stroke: float | None
    coarse: float
    warm_start: str | None
    finish_steps: int
    background: str
    catalogue: str | None
    resume: str | None
    seconds: float | None
    psnr: float | None
    early_stop: float | None
    checkpoint_every: float | None
    frames: int
    frame_side: int
    timelapse: str
    timelapse_seconds: float | None
    report: bool
    focus: str | None
    focus_strength: float
    lpips_backbone: str
    lpips_weights: str | None
    style: Any


@dataclass
class StyleKeys:
    """Types of the keys below ``style`` of ``task=paint``."""

    image: str | None
    brushwork: str | None
    content: float
    colors: str


NESTED = {"style": StyleKeys}  # keys that have keys of their own; what else is below them are options of plugins


@dataclass
class Export(Shared):
    """Types of the keys of ``task=export``; values and meaning are in conf/task/export.yaml."""

    catalogue: str
    resolution: int | None


@dataclass
class Simulate(Shared):
    """Types of the keys of ``task=simulate``."""

    n: int
    path: str | None


@dataclass
class Train(Shared):
    """Types of the keys of ``task=train``; values and meaning are in conf/task/train.yaml and conf/model/."""

    model: str
    data: list[str] | None
    simulate: int | None
    sets: str
    batch_size: int
    epochs: int | None
    minutes: float | None
    lr: float
    ema: float
    precision: str
    limit: int | None
    critic: bool
    critic_lr: float
    critic_weight: float
    critic_width: int
    checkpoint_every: float | None
    resume: str | None


@dataclass
class Evaluate(Shared):
    """Types of the keys of ``task=evaluate``; values and meaning are in conf/task/evaluate.yaml."""

    data: list[str] | None
    split: str
    n: int | None
    other_data: bool
    inception: str | None


@dataclass
class Prune(Shared):
    """Types of the keys of ``task=prune``; values and meaning are in conf/task/prune.yaml."""

    data: list[str] | None
    ratios: list[float]
    n: int | None
    other_data: bool
    batch_size: int
    epochs: int | None
    minutes: float | None
    lr: float
    ema: float
    precision: str
    limit: int | None


@dataclass
class Compare(Shared):
    """Types of the keys of ``task=compare``; values and meaning are in conf/task/compare.yaml."""

    runs: list[str]


@dataclass
class Analyse(Shared):
    """Types of the keys of ``task=analyse``; values and meaning are in conf/task/analyse.yaml."""

    catalogue: str
    against: str | None
    radius: float | None
    visible: float


@dataclass
class View(Shared):
    """Types of the keys of ``task=view``; values and meaning are in conf/task/view.yaml."""

    catalogue: str
    port: int
    open: bool


@dataclass
class Extremes(Shared):
    """Types of the keys of ``task=extremes``; values and meaning are in conf/task/extremes.yaml."""

    renderers: list[str] | None
    blends: list[str] | None
    dtypes: list[str] | None
    scenes: list[str] | None
    patience: float


RANGES = {  # key: lowest value, what it is
    "seed": (0, "a whole number from 0"),
    "threads": (1, "a number of processor cores"),
    "resolution": (1, "a number of pixels"),
    "strokes": (1, "a number of strokes"),
    "n": (1, "a number of strokes"),
    "simulate": (1, "a number of strokes"),
    "pixels_per_stroke": (1, "a number of pixels from 1"),
    "steps": (0, "a number of steps from 0"),
    "steps_per_stroke": (0, "a number of steps from 0"),
    "coarse": (0, "a share of the steps from 0 to 1"),
    "finish_steps": (0, "a number of steps from 0"),
    "seconds": (0, "a number of seconds"),
    "psnr": (0, "a PSNR in dB"),
    "early_stop": (0, "a gain in dB"),
    "checkpoint_every": (0, "a number of seconds"),
    "frames": (0, "a number of pictures from 0"),
    "batch_size": (1, "a number of strokes"),
    "epochs": (0, "a number of passes through the data"),
    "minutes": (0, "a number of minutes"),
    "limit": (1, "a number of strokes"),
    "patience": (0, "a number of seconds"),
    "radius": (0, "a number of pixels"),
    "visible": (0, "a share from 0 to 1"),
    "critic_weight": (0, "a weight"),
    "critic_width": (1, "a number of channels"),
    "frame_side": (2, "a number of pixels from 2"),
    "focus_strength": (1, "a factor from 1"),
    "style.content": (0, "a factor from 0"),
}


def schemas(of: type[Shared] = Shared) -> list[type[Shared]]:
    """The types of keys of every task."""
    return [found for schema in of.__subclasses__() for found in [schema, *schemas(schema)]]


def check_keys(cfg: DictConfig, schema: type[Shared] | type[StyleKeys], above: str = "") -> None:
    """Stop when a key has the wrong type or lies outside its range.

    Args:
        cfg: the config, or the part of it where the keys are.
        schema: their types.
        above: what the user types before them, "style." for instance.

    Raises:
        UserError: with the key, its value, and what it takes.
    """
    typed = OmegaConf.structured(schema)
    for field in fields(schema):
        name, value = f"{above}{field.name}", cfg.get(field.name)
        try:
            typed[field.name] = value
        except OmegaConfBaseException as error:
            raise UserError(f"{name}={value} is not of type {field.type}; give {name} another value") from error
        low, meaning = RANGES.get(name, (None, ""))
        if low is not None and value is not None and not value >= low:
            raise UserError(f"{name}={value} is not {meaning}; set {name} to {low} or more")


def check_losses(cfg: DictConfig, overrides: list[str]) -> None:
    """Stop when no loss is chosen, one is tuned that is not chosen, or a weight is no weight.

    Raises:
        UserError: with the override that would mend the config.
    """
    for family in MULTI_SELECT:
        if any(override.startswith(f"+{family}=") for override in overrides):
            raise UserError(f"+{family}=... is ignored by Hydra beside a list; name them all: '{family}=[mse,...]'")
        chosen = [name for name, node in cfg.get(family, {}).items() if "_target_" in node]
        tuned = [name for name in cfg.get(family, {}) if name not in chosen]
        if tuned:
            names = ",".join([*chosen, *tuned])
            raise UserError(
                f"{family}.{tuned[0]} is tuned but not chosen (chosen: {', '.join(chosen) or 'none'}); "
                f"add it with '{family}=[{names}]' or drop the keys below {family}.{tuned[0]}"
            )
    if "loss" in cfg and not cfg.loss:
        choices = ", ".join(plugin.name for plugin in plugins("loss"))
        raise UserError(f"no loss is chosen, so there is nothing to optimise; try loss=mse (there are: {choices})")
    nodes = {f"loss.{name}": node for name, node in cfg.get("loss", {}).items()}
    nodes |= {f"style.{part}": cfg.style[part] for part in ("loss", "strokes") if "style" in cfg}
    for key, node in nodes.items():
        if not 0 <= node.weight < math.inf:
            raise UserError(f"{key}.weight={node.weight} is not a weight; set {key}.weight to a number from 0")
