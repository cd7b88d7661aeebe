"""Define the config keys of the tasks that simulate strokes, and that train and evaluate renderers."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

from omegaconf import DictConfig

from brushexp.contracts import FILE, INTERRUPTED_RUN, above, at_least, between, one_of
from brushexp.contracts.tasks import RESUME, Task, TrainerOptions, key
from brushexp_training import rules
from brushexp_training.rules import STROKES

LARGEST_SEED_SIMULATED = 2**64 - 1  # upper bound of the stroke generator
SMALLEST_SET = 33  # minimum number of strokes that gives training, validation and test strokes
NETWORK_FIT: dict[str, Any] = {"callbacks": [], "logger": ["csv"]}
DATA = "training strokes: folders of task=simulate, or files in them; null = simulate new ones"
EMA = "decay of the exponential moving average of the weights; 0 = no averaging"
LIMIT = "number of training strokes to use, starting with the first; null = all"


@dataclass
class NetworkTrainerOptions(TrainerOptions):
    """Config keys below ``trainer`` for tasks that train networks and therefore have epochs and validations."""

    max_epochs: int | None = key(
        -1, "maximum number of epochs; -1 = no limit (tasks have their own limits)", at_least(-1, typical=10)
    )
    min_epochs: int | None = key(None, "minimum number of epochs", at_least(0, typical=1))
    min_steps: int | None = key(None, "minimum number of gradient steps", at_least(0, typical=100))
    limit_train_batches: int | float | None = key(
        None, "batches per epoch: a number, or a fraction such as 0.5", at_least(0, typical=0.5)
    )
    limit_val_batches: int | float | None = key(
        None, "batches per validation: a number, or a fraction such as 0.5", at_least(0, typical=0.5)
    )
    val_check_interval: int | float | None = key(
        None, "batches between validations: a number, or a fraction such as 0.5", above(0, typical=0.5)
    )
    check_val_every_n_epoch: int | None = key(None, "epochs between validations", at_least(1, typical=1))
    accumulate_grad_batches: int | None = key(None, "batches accumulated into a gradient step", at_least(1, typical=2))


@dataclass
class SimulateTask(Task):
    """Simulate brush strokes on an empty canvas for training renderers."""

    is_research = True
    module = "brushexp_training.tasks.simulate"
    check = staticmethod(rules.check_simulate)
    groups: ClassVar[dict[str, Any]] = {"engine": "fluid"}

    seed: int = key(
        0,
        "number from which all random choices follow; the same seed gives the same result",
        between(0, LARGEST_SEED_SIMULATED),
    )
    n: int = key(10000, "number of strokes (the thesis: 100,000); a larger n continues a finished set", at_least(1))
    path: str | None = key(None, "folder of the set; an unfinished set there is continued; null = strokes/ in output")

    @staticmethod
    def grows(cfg: DictConfig, folder: Path) -> bool:
        return cfg.path is None and (folder / "strokes").is_dir()


@dataclass
class TrainTask(Task):
    """Train a renderer on simulated strokes."""

    is_research = True
    module = "brushexp_training.tasks.train"
    check = staticmethod(rules.check_train)
    groups: ClassVar[dict[str, Any]] = {"renderer": "neural", "engine": "fluid"} | NETWORK_FIT
    presets: ClassVar[dict[str, str]] = {"trainer": "network"}
    settings: ClassVar[dict[str, Any]] = {"renderer": {"checkpoint": None}}  # random weights

    data: list[str] | None = key(None, DATA, STROKES)
    simulate: int | None = key(
        10000, "without data: strokes to simulate and store; null = new strokes on demand", at_least(SMALLEST_SET)
    )
    sets: str = key("data", "folder for simulated sets")
    batch_size: int = key(64, "strokes per gradient step", at_least(1))
    epochs: int | None = key(None, "passes through the data; null = no limit; 0 = no training", at_least(0, typical=10))
    minutes: float | None = key(60, "wall time limit, over which the learning rate decays; null = none", at_least(0))
    lr: float = key(5.0e-4, "peak learning rate; at 1e-3 and above, some runs collapse to blank pictures", above(0, 1))
    ema: float = key(0.999, EMA, between(0, 1))
    limit: int | None = key(None, LIMIT, at_least(1, typical=10000))
    fresh_starts: int = key(3, "restarts of a network that draws all strokes alike", between(0, 100))
    detail: float = key(1.0, "weight of the loss on the finest details (high frequencies)", at_least(0))
    tone: float = key(4.0, "weight of the loss on colour where there is paint", at_least(0))
    critic: bool = key(False, "whether to add a RaSGAN loss, from a critic of the pictures, to L2")
    critic_lr: float = key(2.0e-3, "peak learning rate of the critic (two time scales: four times lr)", above(0, 1))
    critic_weight: float = key(0.1, "gradient of the critic's loss, as a fraction of the gradient of L2", at_least(0))
    critic_width: int = key(16, "channels of the critic at full resolution", at_least(1))
    fid: int = key(256, "held-out strokes on which each validation computes the FID (effl0); 0 = no FID", at_least(0))
    checkpoint_every: float | None = key(120, "seconds between checkpoints; null = only when interrupted", at_least(0))
    resume: str | None = key(None, RESUME, INTERRUPTED_RUN)
    trainer: NetworkTrainerOptions = field(default_factory=NetworkTrainerOptions)

    @staticmethod
    def inputs(cfg: DictConfig) -> dict[str, str]:
        from brushexp_training.stroke_sets.dataset import StrokeSet  # noqa: PLC0415

        sets = {path: StrokeSet(Path(path)) for path in cfg.data or []}  # a set that has grown is reshuffled
        return {f"data={path}": f"{len(one)} strokes of seed {one.seed}" for path, one in sets.items()}


@dataclass
class NetworkTask(Task):
    """Config keys of tasks that train networks other than renderers."""

    is_research = True
    groups: ClassVar[dict[str, Any]] = NETWORK_FIT

    epochs: int | None = key(None, "number of epochs of 500 steps; null = no limit", at_least(0, typical=8))
    minutes: float | None = key(60, "wall time limit, over which the learning rate decays; null = none", at_least(0))
    checkpoint_every: float | None = key(120, "seconds between checkpoints; null = only when interrupted", at_least(0))
    resume: str | None = key(None, RESUME, INTERRUPTED_RUN)
    trainer: NetworkTrainerOptions = field(default_factory=NetworkTrainerOptions)

    @staticmethod
    def check(cfg: DictConfig, overrides: Sequence[str]) -> None:
        rules.check_ends(cfg)


@dataclass
class EvaluateTask(Task):
    """Measure a renderer on new strokes (several: -m renderer=analytic,neural data=FOLDER other_data=true)."""

    is_research = True
    module = "brushexp_training.tasks.evaluate"
    check = staticmethod(rules.check_evaluate)
    groups: ClassVar[dict[str, Any]] = {"renderer": "neural", "blend": "tiled", "engine": "fluid"}

    data: list[str] | None = key(None, DATA, STROKES)
    split: str = key("test", "part of the data to evaluate on", one_of("test", "validation"))
    n: int | None = key(
        None, "number of strokes to evaluate on; null = all, or 1000 simulated ones", at_least(1, typical=1000)
    )
    other_data: bool = key(False, "whether to allow strokes of a brush not used in training")
    inception: str | None = key(None, "file inception-2015-12-05.pt (TorchScript) for the published FID", FILE)
