"""Define the tasks of this package and their command-line keys."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from brushexp_training.schema import EMA, NetworkTask
from omegaconf import MISSING, DictConfig

from brushexp.contracts import FILE, FOLDER, Rule, UserError, above, at_least, between
from brushexp.contracts.tasks import CATALOGUE, PICTURE, Task, key
from brushexp_recovery.find.photograph import size_of_photograph

WIDTH_HELP = "width of the painting from edge to edge of the photograph, in cm; null = measures in pixels only"
SIZE_HELP = "width and height of the painting in cm, such as 92x73, instead of only its width"


def _check_path(path: str, option: str) -> None:
    if not Path(path).exists():
        raise UserError(f"{option}={path}: there is no such file or folder; correct the path")


FILE_OR_FOLDER = Rule(_check_path)


@dataclass
class RecoverTask(Task):
    """Recover the strokes of a painting from a photograph, as a catalogue for other tasks."""

    module = "brushexp_recovery.tasks.recover"
    alone = "image"

    image: str = key(MISSING, "photograph of a painting: a picture file, or the name of a sample", PICTURE)
    width_cm: float | None = key(
        None, "width of the painting in the picture, in cm, to measure strokes in mm", above(0, typical=60)
    )
    scale: float | None = key(
        None,
        "scale of the photograph for finding strokes; null = strokes are about 18 px wide",
        between(0.05, 8, typical=1),
    )
    copies: int = key(
        1, "number of rotated and mirrored copies per look; more are slower but more certain", between(1, 8)
    )
    weights: str = key("strokes", "shipped weights, or the .safetensors of task=train_recovery")
    marks: str | None = key(None, "file of corrections saved by the page of strokes; null = none", FILE)

    @staticmethod
    def check(cfg: DictConfig, overrides: Sequence[str]) -> None:
        from brushexp_recovery.marks.corrections import check_marks  # noqa: PLC0415

        size = size_of_photograph(cfg.image)
        if cfg.marks is not None:
            check_marks(Path(cfg.marks), size)


@dataclass
class MeasureTask(Task):
    """Measure the brushwork in a photograph of a painting, and write strokes, intervals, tables and a page.

    ``task=analyse`` with a picture runs this task.
    """

    module = "brushexp_recovery.tasks.measure"
    alone = "image"

    image: str = key("astronaut", "photograph, cropped to the edges of the painting", PICTURE)
    recovered: str | None = key(
        None, "folder of its task=recover run, or the catalogue.h5 there; null = recover it now", CATALOGUE
    )
    against: str | None = key(None, "photograph of another painting to compare with", PICTURE)
    width_cm: float | None = key(None, WIDTH_HELP, above(0, typical=60))
    size_cm: str | None = key(None, SIZE_HELP)
    sizes: str | None = key(None, "table (.csv) of the widths of several photographs: file,width_cm; null = none", FILE)
    against_width_cm: float | None = key(None, WIDTH_HELP, above(0, typical=60))
    against_size_cm: str | None = key(None, SIZE_HELP)
    region: list[str] | None = key(None, "parts to measure: left,top,width,height in pixels, or masks, bright inside")
    views: int = key(6, "number of views used for intervals: the photograph and small changes of it", between(1, 50))
    draws: int = key(40, "number of samples of strokes by their confidence from each view", between(1, 1000))
    correct: bool = key(
        True, "whether figures are corrected for recovery's error; false if you have corrected the strokes by hand"
    )
    threshold: float | None = key(
        None,
        "minimum confidence of the strokes shown first on the page; null = 0.5, or lower to show at least half",
        between(0, 1, typical=0.5),
    )
    seed: int = key(0, "seed of views and draws", at_least(0))

    @staticmethod
    def suits(typed: Mapping[str, Any]) -> bool:
        from brushexp.contracts.files import catalogue_suffixes  # noqa: PLC0415

        image = str(typed.get("image") or "")
        files = [Path(file) for file in ([image] if Path(image).exists() else image.split(","))]
        return all(file.is_file() and file.suffix.lower() not in catalogue_suffixes() for file in files)

    @staticmethod
    def check(cfg: DictConfig, overrides: Sequence[str]) -> None:
        from brushexp_recovery.measure.scale import millimetres_per_pixel, width_in_table  # noqa: PLC0415

        if cfg.sizes is not None:
            if cfg.width_cm is not None or cfg.size_cm is not None:
                raise UserError("sizes=, width_cm= and size_cm= say the same; give one of them")
            width_in_table(Path(cfg.sizes), cfg.image)
        millimetres_per_pixel(size_of_photograph(cfg.image), cfg.width_cm, cfg.size_cm)
        sizes = {"against_width_cm": cfg.against_width_cm, "against_size_cm": cfg.against_size_cm}
        if cfg.against is not None:
            size = size_of_photograph(cfg.against, "against")
            millimetres_per_pixel(size, cfg.against_width_cm, cfg.against_size_cm, "against_")
        elif typed := [name for name, size in sizes.items() if size is not None]:
            raise UserError(f"{typed[0]} is the size of a second photograph; give against=...")


@dataclass
class BenchmarkTask(Task):
    """Find strokes in paintings with known strokes, by recovery and by other methods, and score the results."""

    is_research = True
    module = "brushexp_recovery.tasks.benchmark"

    kinds: list[str] | None = key(None, "kinds of paintings: the six kinds, or families of paint; null = the six kinds")
    unseen: bool = key(
        False, "whether to leave out kinds on which the weights were trained; kinds=null then includes families"
    )
    counts: list[int] = key([150, 500, 1500], "numbers of strokes, each for every kind", at_least(1))
    repeats: int = key(1, "number of paintings of each kind and number of strokes", at_least(1))
    side: int = key(512, "side of a painting in pixels", between(64, 4096))
    methods: list[str] | None = key(None, "methods that find strokes; null = all; [] = only write the paintings")
    weights: str = key("strokes", "weights of recovery: shipped weights, or the .safetensors of task=train_recovery")
    hard: bool = key(True, "whether to also score a photograph of each painting: canvas, blur, noise, JPEG")
    add: str | None = key(None, "folder of strokes by another method: NAME.png, .npy, .npz or .h5; null = none", FOLDER)
    seed: int = key(20_251_125, "seed of the paintings; another seed makes another benchmark", at_least(0))

    @staticmethod
    def check(cfg: DictConfig, overrides: Sequence[str]) -> None:
        from brushexp_recovery.benchmark.baselines.methods import METHODS  # noqa: PLC0415
        from brushexp_recovery.benchmark.scenes import KINDS  # noqa: PLC0415
        from brushexp_recovery.synthesis.families.family import find_families  # noqa: PLC0415

        kinds = (*KINDS, *sorted(find_families()))
        for name, choices in (("kinds", kinds), ("methods", tuple(METHODS))):
            if unknown := [one for one in cfg[name] or () if one not in choices]:
                raise UserError(f"{name} has no {unknown[0]!r}; choose from: {', '.join(choices)}")


@dataclass
class ScoreTask(Task):
    """Score strokes found in a painting against the known strokes, or against marks drawn by people."""

    is_research = True
    module = "brushexp_recovery.tasks.score"

    truth: str = key(MISSING, "NAME.npz of task=benchmark, marks by hand (.json), or a folder of marks", FILE_OR_FOLDER)
    strokes: str = key(
        MISSING,
        "labels (.png, .npy, .npz), curves (.npz), a catalogue (.h5, .json), marks, or a folder of them",
        FILE_OR_FOLDER,
    )


@dataclass
class TrainRecoveryTask(NetworkTask):
    """Train the models of task=recover on paintings that are generated during training."""

    module = "brushexp_recovery.tasks.train"
    presets: ClassVar[dict[str, str]] = {"trainer": "network"}

    subjects: list[str] | None = key(None, "pictures to paint, or folders of them; null = pictures of scikit-image")
    start: str | None = key(None, "initial weights of the network, shipped or a .safetensors file; null = random")
    sets: str = key("data/recovery", "folder for the paintings; existing paintings are reused")
    paintings: int = key(400, "number of paintings to learn from", at_least(1))
    painters: int = key(1, "number of processes that make paintings during the training", at_least(1))
    families: bool = key(
        True, "whether half of the paintings are of families of paint; otherwise engines and renderers make all of them"
    )
    leave_out: list[str] = key([], "families of paint to hold out; task=benchmark unseen=true then measures them")
    batch_size: int = key(5, "crops per gradient step", at_least(1))
    minutes: float | None = key(100, "wall time limit, over which the learning rate decays; null = none", at_least(0))
    lr: float = key(3.0e-3, "peak learning rate", above(0, 1))
    ema: float = key(0.998, EMA, between(0, 1))

    @staticmethod
    def check(cfg: DictConfig, overrides: Sequence[str]) -> None:
        from brushexp_recovery.synthesis.families.family import find_families  # noqa: PLC0415

        NetworkTask.check(cfg, overrides)
        if unknown := [name for name in cfg.leave_out if name not in find_families()]:
            raise UserError(f"leave_out has no {unknown[0]!r}; choose from: {', '.join(sorted(find_families()))}")
        if cfg.leave_out and not cfg.families:
            raise UserError("leave_out= holds out families of paint, but families=false has none; add families=true")
