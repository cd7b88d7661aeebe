"""Keys of ``task=benchmark`` and of ``task=score``."""

from collections.abc import Sequence
from dataclasses import dataclass

from omegaconf import MISSING, DictConfig

from brushexp.bounds import FILE, FOLDER, at_least, between
from brushexp.config.keys import key
from brushexp.config.schema import Task
from brushexp.errors import UserError


@dataclass
class BenchmarkTask(Task):
    """Find the strokes of paintings whose strokes are known, by recovery and by other methods, and score them."""

    is_research = True
    module = "brushexp_recovery.benchmark_task"

    kinds: list[str] | None = key(None, "of paintings; null = all: those that training has seen, and those it has not")
    counts: list[int] = key([150, 500, 1500], "numbers of strokes, each for every kind", at_least(1))
    repeats: int = key(1, "paintings of each kind and number", at_least(1))
    side: int = key(512, "of a painting, pixels", between(64, 4096))
    methods: list[str] | None = key(None, "that find strokes; null = all; [] = only write the paintings")
    weights: str = key("strokes", "of recovery: shipped ones, or the .safetensors of task=train_recovery")
    hard: bool = key(True, "also a photograph of each painting: canvas, blur, noise, JPEG")
    add: str | None = key(None, "folder of strokes by others: NAME.png, .npy, .npz or .h5; null = none", FOLDER)
    seed: int = key(20_251_125, "of the paintings; another one makes another benchmark", at_least(0))

    @staticmethod
    def check(cfg: DictConfig, overrides: Sequence[str]) -> None:
        from brushexp_recovery.baselines import METHODS  # noqa: PLC0415
        from brushexp_recovery.benchmark_scenes import KINDS  # noqa: PLC0415

        for name, choices in (("kinds", KINDS), ("methods", tuple(METHODS))):
            if unknown := [one for one in cfg[name] or () if one not in choices]:
                raise UserError(f"{name} has no {unknown[0]!r}; choose from: {', '.join(choices)}")


@dataclass
class ScoreTask(Task):
    """Score strokes that somebody found in a painting against the known ones: F1, errors, order, calibration."""

    is_research = True
    module = "brushexp_recovery.score_task"

    truth: str = key(MISSING, "NAME.npz that task=benchmark wrote", FILE)
    strokes: str = key(MISSING, "labels (.png, .npy, .npz), curves (.npz) or a catalogue (.h5, .json)", FILE)
