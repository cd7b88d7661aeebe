"""Declare the plugin families and keys of the core tasks; each key has a type, default, bounds and description."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

from omegaconf import MISSING, DictConfig

from brushexp.bounds import DURATION, INTERRUPTED_RUN, above, at_least, between, one_of
from brushexp.config import rules
from brushexp.config.keys import key
from brushexp.config.output_folders import BESIDE_PAINTING, BY_TIME
from brushexp.config.rules import CATALOGUE, COLOR, DEVICE, FACES, FOCUS, WORKING
from brushexp.pictures.load import PICTURE
from brushexp.plugins.metric.base import STANDARD
from brushexp.shading.light import BOUNDS, Light

PRECISIONS = ("32-true", "bf16-mixed", "16-mixed", "bf16-true", "16-true", "64-true", "32", "bf16", "16", "64")
LARGEST_SEED = 2**32 - 1  # the largest seed of NumPy's generator
RESUME = "folder of an interrupted run to continue exactly, with its own settings"


@dataclass
class StyleTransfer:
    """Keys below ``style`` of ``task=paint``; style=painting.jpg is short for style.image=painting.jpg."""

    image: str | None = key(None, "painting whose style to transfer, a file or sample; null = none", PICTURE)
    brushwork: str | None = key(None, "catalogue.h5 of a painting whose brushwork to imitate; null = none", CATALOGUE)
    content: float = key(
        0.5, "weight of the picture relative to style.image: a factor on the weights of loss=", at_least(0)
    )
    colors: str = key("style", "source of the colours: style or content", one_of("style", "content"))


@dataclass
class Lamp:
    """Keys below ``light`` of ``task=paint``; light=315,45 is short for light.azimuth=315 light.elevation=45."""

    depth: float = key(Light.depth, "thickness of the paint in the light; 1 = natural, 0 = flat", BOUNDS["depth"])
    azimuth: float = key(
        Light.azimuth, "direction of the lamp, in degrees clockwise from the top; 315 = upper left", BOUNDS["azimuth"]
    )
    elevation: float = key(
        Light.elevation,
        "angle of the lamp above the canvas, in degrees; a low lamp shows more relief",
        BOUNDS["elevation"],
    )
    gloss: float = key(Light.gloss, "shine of the paint, 0 (matt) to 1 (wet)", BOUNDS["gloss"])


@dataclass
class OtherLamp:
    """Keys below ``light`` of ``task=export``, with the same meanings as in ``task=paint``."""

    depth: float | None = key(None, "thickness of the paint; 0 = flat; null = as painted", BOUNDS["depth"])
    azimuth: float | None = key(
        None, "direction of the lamp, in degrees clockwise from the top; null = as painted", BOUNDS["azimuth"]
    )
    elevation: float | None = key(
        None, "angle of the lamp above the canvas, in degrees; null = as painted", BOUNDS["elevation"]
    )
    gloss: float | None = key(None, "shine of the paint, 0 (matt) to 1 (wet); null = as painted", BOUNDS["gloss"])


@dataclass
class TrainerOptions:
    """Keys below ``trainer``: options of Lightning's Trainer, named as in its manual; null is Lightning's default."""

    profiler: str | None = key(
        None,
        "measurement of the time that each part takes, in profile.txt: simple or advanced; null = none",
        one_of("simple", "advanced"),
    )
    precision: str = key("32-true", "numerical precision; bf16-mixed = networks use 16 bits", one_of(*PRECISIONS))
    max_steps: int = key(-1, "maximum number of gradient steps; -1 = no limit", at_least(-1, typical=1000))
    max_time: str | None = key(None, "maximum wall time, as days:hours:minutes:seconds", DURATION)
    log_every_n_steps: int = key(1, "steps between logged values; in a painting at least 0.25 s apart", at_least(1))
    gradient_clip_val: float | None = key(
        None, "size at which gradients are clipped; null = no clipping", above(0, typical=1)
    )
    gradient_clip_algorithm: str | None = key(None, "quantity to clip: norm or value", one_of("norm", "value"))
    detect_anomaly: bool | None = key(None, "whether to find the operation that produced a NaN; slow")
    deterministic: bool | None = key(None, "whether to use deterministic operations only")
    benchmark: bool | None = key(None, "whether cuDNN searches for the fastest convolutions")
    enable_progress_bar: bool = key(False, "whether to show Lightning's progress bar beside the program's own")
    enable_model_summary: bool = key(False, "whether to print layers and parameter counts at the start")


@dataclass
class Task:
    """Keys that all tasks have; each task is a subclass, and an entry point in the ``brushexp.tasks`` group."""

    # Config groups, most of them families of plugins, and the chosen member of each; ``loss@style.loss`` is a loss with
    # options below ``style.loss``. Presets override the values here.
    groups: ClassVar[dict[str, Any]] = {}
    presets: ClassVar[dict[str, str]] = {}
    settings: ClassVar[dict[str, Any]] = {}  # options that differ from the plugins' defaults
    is_research: ClassVar[bool] = False  # whether --help=research lists it instead of --help=tasks
    module: ClassVar[str]  # module with ``run(cfg, folder, start)``, which performs the task and returns its metrics
    alone: ClassVar[str] = ""  # key that a path typed alone sets: brushexp export outputs/x
    painted: ClassVar[str] = ""  # names of the task's results that ``task=export`` can read
    results: ClassVar[tuple[str, ...]] = ()  # names of files that the task overwrites, without extensions
    writes_metrics: ClassVar[bool] = False  # whether the module writes metrics.json and its provenance itself

    @staticmethod
    def suits(typed: Mapping[str, Any]) -> bool:
        """Return whether a command line or config calls for this task instead of the one that it can replace."""
        return False

    @staticmethod
    def grows(cfg: DictConfig, folder: Path) -> bool:
        """Return whether a run adds to the results that are already in its folder."""
        return False

    @staticmethod
    def check(cfg: DictConfig, overrides: Sequence[str]) -> None:
        """Raise a UserError, before anything runs, for mistakes that types and bounds do not catch."""

    @staticmethod
    def inputs(cfg: DictConfig) -> dict[str, str]:
        """Describe non-file inputs that must be unchanged when a run is resumed: ``key=value`` -> ``33 strokes``."""
        return {}

    seed: int = key(
        0, "number from which all random choices follow; the same seed gives the same result", between(0, LARGEST_SEED)
    )
    device: str = key("auto", "hardware to compute on: auto, cpu, cuda (an NVIDIA GPU), cuda:1, ...", DEVICE)
    threads: int | None = key(
        None, "number of processor cores; null = all, shared by the jobs of a sweep", at_least(1, typical=2)
    )
    output: str = key(BY_TIME, "folder for the run, or for all runs of a sweep")
    overwrite: bool = key(False, "whether to replace a run or sweep in the output folder")
    objective: str | None = key(None, "metric in metrics.json for Optuna to optimise, such as psnr; null = none")


@dataclass
class PaintTask(Task):
    """Paint a picture: optimise strokes until they look like it."""

    module = "brushexp.tasks.paint"
    alone = "image"
    painted = "FOLDER"
    writes_metrics = True
    results: ClassVar[tuple[str, ...]] = (
        "painting",
        "target",
        "flat",
        "style",
        "focus",
        "timelapse",
        "catalogue",
        "strokes",
    )
    common: ClassVar[tuple[str, ...]] = (  # keys on the first page of the help
        *("image", "resolution", "strokes", "detail", "abstraction", "steps", "seconds", "psnr", "background"),
        *("focus", "faces", "style.image", "light.depth", "frames", "report", "resume"),
        *("seed", "device", "threads", "output", "overwrite"),
    )
    check = staticmethod(rules.check_paint)
    groups: ClassVar[dict[str, Any]] = {"painter": "gradient"}
    groups |= {"init": "slic", "renderer": "analytic", "blend": "tiled"}
    groups |= {"color": "rgb", "order": "area", "palette": "own", "paper": "smooth"}
    groups |= {"loss": ["mse"], "density": "fixed", "sampler": "whole", "optimizer": "adam"}
    groups |= {"change": ["variety"], "callbacks": []}
    groups |= {"metric": list(STANDARD)}
    groups |= {"logger": ["csv"], "loss@style.loss": "style", "loss@style.strokes": "brushwork"}
    presets: ClassVar[dict[str, str]] = {"trainer": "default", "look": "oil", "quality": "normal"}
    settings: ClassVar[dict[str, Any]] = {
        "style": {
            "loss": {"image": "${style.image}", "colors": "${style.colors}"},  # loss that style.image adds
            "strokes": {"catalogue": "${style.brushwork}"},  # loss that style.brushwork adds
        }
    }

    image: str = key("astronaut", "picture file, or the name of a sample of scikit-image", PICTURE)
    resolution: int | None = key(
        None, "longer side of the picture in pixels; null = its own", between(1, 16384, typical=1024)
    )
    working_resolution: str | None = key(
        "auto", "longer side at which strokes are optimised; auto = by their number; null = all pixels", WORKING
    )
    strokes: int | None = key(
        None,
        "number of strokes; auto = as many as the picture needs; null = by pixels_per_stroke",
        at_least(1, typical=1000),
    )
    detail: float = key(1, "number of strokes relative to the look's: 2 = twice as many (set by quality=)", above(0))
    abstraction: float = key(
        0,
        "simplification, 0 to 1: fewer, larger strokes and flatter forms; faces keep their detail",
        between(0, 1, typical=0.7),
    )
    pixels_per_stroke: float = key(100, "area of the picture per stroke, in pixels", at_least(1))
    max_strokes: int | None = key(
        None, "maximum number of strokes by pixels_per_stroke; null = none", at_least(1, typical=8000)
    )
    effort: float = key(1, "number of steps relative to the look's: 2 = twice as many (set by quality=)", at_least(0))
    keep_stroke_size: bool = key(False, "whether quality= adds steps instead of strokes (set by look=)")
    steps: int = key(500, "number of gradient steps; 0 = paint the initial strokes", at_least(0))
    steps_per_stroke: float | None = key(
        None, "mean updates per stroke; overrides steps; null = none", at_least(0, typical=20)
    )
    coarse: float = key(
        0, "share of the steps, from the first on, at half the resolution", between(0, 0.99, typical=0.5)
    )
    warm_up: str | None = key("auto", "fast renderer for the first steps; auto = suggested by renderer=; null = none")
    finish_steps: int = key(40, "updates per stroke with the chosen renderer after the warm-up", at_least(0))
    background: str = key(
        "mean", "colour of the bare canvas: mean, ivory, '#rrggbb', ... or transparent (keep the alpha)", COLOR
    )
    catalogue: str | None = key(
        None, "folder or catalogue.h5 of a painting whose strokes to start from, instead of init", CATALOGUE
    )
    resume: str | None = key(None, RESUME, INTERRUPTED_RUN)
    seconds: float | None = key(None, "seconds of optimisation; overrides steps; null = none", above(0, typical=60))
    psnr: float | None = key(
        None, "PSNR in dB at which to stop; with strokes=auto, the PSNR to reach; null = none", at_least(0, typical=30)
    )
    early_stop: float | None = key(
        None, "PSNR gain in dB per 100 evaluations below which to stop; null = none", at_least(0, typical=0.1)
    )
    checkpoint_every: float | None = key(60, "seconds between checkpoints; null = only when interrupted", at_least(0))
    frames: int = key(60, "number of frames of the timelapse; 0 = no timelapse", between(0, 2000))
    frame_side: int = key(720, "longer side of the timelapse in pixels", between(2, 4096))
    timelapse: str = key("mp4", "format of the timelapse: mp4 or gif", one_of("mp4", "gif"))
    timelapse_seconds: float | None = key(
        None, "duration of the timelapse in seconds; null = 15 frames/s", above(0, typical=10)
    )
    report: bool = key(True, "whether to write report.html, one page about the run with a replay of the painting")
    focus: str | None = key(
        None, "important regions: auto = what draws the eye; or a mask, bright = important; null = none", FOCUS
    )
    focus_strength: float = key(8, "weight of errors in the focus relative to errors elsewhere", between(1, 1000))
    faces: str = key(
        "auto",
        "where strokes are small and focus=auto is strongest: auto = in detected faces; a mask adds more; off",
        FACES,
    )
    light: Lamp = field(default_factory=Lamp)
    style: StyleTransfer = field(default_factory=StyleTransfer)
    trainer: TrainerOptions = field(default_factory=TrainerOptions)


@dataclass
class ExportTask(Task):
    """Export a finished painting to pictures of any size, vector files, tables and more: to=png,svg,json,csv."""

    module = "brushexp.tasks.export"
    alone = "catalogue"
    check = staticmethod(rules.check_export)
    groups: ClassVar[dict[str, Any]] = {"to": ["png"], "renderer": None, "blend": "tiled"}

    catalogue: str = key(MISSING, "folder of a run, its catalogue.h5, or a strokes.json from to=json", CATALOGUE)
    resolution: int | None = key(None, "longer side in pixels; null = as painted", between(1, 65536, typical=4096))
    output: str = key(
        BESIDE_PAINTING, "folder for the files (default: beside the painting), or for all exports of a sweep"
    )
    light: OtherLamp = field(default_factory=OtherLamp)
