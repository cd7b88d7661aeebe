"""The tasks: type, default, bounds and meaning of each key in one line, and the plugins that the task needs."""

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
LARGEST_SEED = 2**32 - 1  # NumPy's generator takes no larger seed
RESUME = "folder of an interrupted run: continue it exactly, with its own settings"


@dataclass
class StyleTransfer:
    """Keys below ``style`` of ``task=paint``; style=painting.jpg is short for style.image=painting.jpg."""

    image: str | None = key(None, "a painting whose style is transferred, a file or sample; null = none", PICTURE)
    brushwork: str | None = key(None, "catalogue.h5 of a painting whose strokes are imitated; null = none", CATALOGUE)
    content: float = key(0.5, "multiplies the weights of loss= while style.image is set", at_least(0))
    colors: str = key("style", "colours of the painting: of the style, or of the content", one_of("style", "content"))


@dataclass
class Lamp:
    """Keys below ``light`` of ``task=paint``; light=315,45 is short for light.azimuth=315 light.elevation=45."""

    depth: float = key(Light.depth, "thickness of the paint in the light; 1 = natural, 0 = flat", BOUNDS["depth"])
    azimuth: float = key(Light.azimuth, "direction of the lamp, in degrees clockwise from the top; 315 = upper left")
    elevation: float = key(Light.elevation, "elevation of the lamp above the canvas, in degrees", BOUNDS["elevation"])
    gloss: float = key(Light.gloss, "gloss of the paint, 0 (matt) to 1 (wet)", BOUNDS["gloss"])


@dataclass
class OtherLamp:
    """Keys below ``light`` of ``task=export``, as in ``task=paint``."""

    depth: float | None = key(None, "thickness of the paint; 0 = flat; null = as painted", BOUNDS["depth"])
    azimuth: float | None = key(None, "direction of the lamp, in degrees clockwise from the top; null = as painted")
    elevation: float | None = key(None, "elevation of the lamp in degrees; null = as painted", BOUNDS["elevation"])
    gloss: float | None = key(None, "gloss of the paint, 0 (matt) to 1 (wet); null = as painted", BOUNDS["gloss"])


@dataclass
class TrainerOptions:
    """Keys below ``trainer``: options of Lightning's Trainer, as its manual has them; what is null is left to it."""

    profiler: str | None = key(
        None, "write where the time was spent into profile.txt; null = no", one_of("simple", "advanced")
    )
    precision: str = key("32-true", "precision; bf16-mixed = networks compute in 16 bits", one_of(*PRECISIONS))
    max_steps: int = key(-1, "gradient steps at most; -1 = no limit", at_least(-1))
    max_time: str | None = key(None, "limit of wall time, days:hours:minutes:seconds", DURATION)
    log_every_n_steps: int = key(1, "steps between logged values; in painting, at least 0.25 s", at_least(1))
    gradient_clip_val: float | None = key(None, "clip gradients at this value; null = no clipping", above(0))
    gradient_clip_algorithm: str | None = key(None, "clip the norm of gradients, or values", one_of("norm", "value"))
    detect_anomaly: bool | None = key(None, "find the operation that produced a NaN; slow")
    deterministic: bool | None = key(None, "use deterministic operations only")
    benchmark: bool | None = key(None, "let cuDNN choose the fastest convolutions")
    enable_progress_bar: bool = key(False, "show Lightning's progress bar beside that of the program")
    enable_model_summary: bool = key(False, "print the layers and numbers of parameters at the start")


@dataclass
class Task:
    """Keys of every task; a task is a subclass, published as an entry point of the group ``brushexp.tasks``."""

    # Groups of configs, most of them families of plugins, and what is chosen of each; ``loss@style.loss`` is a loss
    # whose options are below ``style.loss``. Presets are values of the keys and win over those here.
    groups: ClassVar[dict[str, Any]] = {}
    presets: ClassVar[dict[str, str]] = {}
    settings: ClassVar[dict[str, Any]] = {}  # values below the groups that differ from the defaults of their plugins
    is_research: ClassVar[bool] = False  # whether it is listed by --help=research, not by --help=tasks
    module: ClassVar[str]  # has ``run(cfg, folder, start)``, which carries the task out and returns its numbers
    alone: ClassVar[str] = ""  # the key that a path without one is: brushexp export outputs/x
    painted: ClassVar[str] = ""  # what of its results ``task=export`` can take
    results: ClassVar[tuple[str, ...]] = ()  # names of files that it writes over, without their endings
    writes_metrics: ClassVar[bool] = False  # whether the module writes metrics.json itself, with its provenance

    @staticmethod
    def suits(typed: Mapping[str, Any]) -> bool:
        """Whether values of keys, typed or of a config, ask for this task where it may stand in for another one."""
        return False

    @staticmethod
    def grows(cfg: DictConfig, folder: Path) -> bool:
        """Whether this run adds to results that are in its folder already."""
        return False

    @staticmethod
    def check(cfg: DictConfig, overrides: Sequence[str]) -> None:
        """Stop with a UserError at what is wrong beyond types and bounds, before anything runs."""

    @staticmethod
    def inputs(cfg: DictConfig) -> dict[str, str]:
        """Describe, by ``key=value``, what beside files a continued run must find as it was: ``33 strokes``."""
        return {}

    seed: int = key(0, "seed of all random numbers", between(0, LARGEST_SEED))
    device: str = key("auto", "device to compute on: auto, cpu, cuda, cuda:1, ...", DEVICE)
    threads: int | None = key(None, "processor cores to use; null = all, shared by the jobs of a sweep", at_least(1))
    output: str = key(BY_TIME, "folder of the run, or of all runs of a sweep")
    overwrite: bool = key(False, "delete the files of the run or sweep in output, and replace it")
    objective: str | None = key(None, "the metric of metrics.json that Optuna optimises, such as psnr; null = none")


@dataclass
class PaintTask(Task):
    """Optimise a catalogue of strokes until it looks like the picture."""

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
    common: ClassVar[tuple[str, ...]] = (  # keys of the first page of the help
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
            "loss": {"image": "${style.image}", "colors": "${style.colors}"},  # added to loss= with style.image
            "strokes": {"catalogue": "${style.brushwork}"},  # added to loss= with style.brushwork
        }
    }

    image: str = key("astronaut", "a picture file, or the name of a picture that scikit-image ships", PICTURE)
    resolution: int | None = key(None, "resample to this longer side in pixels; null = as it is", between(1, 16384))
    working_resolution: str | None = key(
        "auto", "longer side at which strokes are optimised: auto = what their number needs; null = all pixels", WORKING
    )
    strokes: int | None = key(
        None, "number of strokes; auto = as the scene needs; null = by pixels_per_stroke", at_least(1)
    )
    detail: float = key(1, "multiplies the look's number of strokes (set by quality=)", above(0))
    abstraction: float = key(
        0, "0 to 1: fewer, larger strokes and flatter forms, while faces keep what the focus keeps", between(0, 1)
    )
    pixels_per_stroke: float = key(100, "area of the picture for each stroke, in pixels", at_least(1))
    max_strokes: int | None = key(None, "limit of the strokes by pixels_per_stroke; null = no limit", at_least(1))
    effort: float = key(1, "multiplies the look's number of steps (set by quality=)", at_least(0))
    keep_stroke_size: bool = key(False, "quality= takes more steps instead of smaller strokes (set by look=)")
    steps: int = key(500, "gradient steps; 0 = paint the initialisation", at_least(0))
    steps_per_stroke: float | None = key(None, "average updates per stroke; overrides steps; null = none", at_least(0))
    coarse: float = key(0, "fraction of the steps, the first ones, at half the resolution", between(0, 0.99))
    warm_up: str | None = key("auto", "fast renderer of the first steps; auto = the chosen one's; null = none")
    finish_steps: int = key(40, "updates per stroke with the chosen renderer after the warm-up", at_least(0))
    background: str = key(
        "mean", "colour of the bare canvas: mean (of the picture), transparent (as it), ivory, '#rrggbb'", COLOR
    )
    catalogue: str | None = key(None, "start from the strokes of this catalogue.h5 instead of init", CATALOGUE)
    resume: str | None = key(None, RESUME, INTERRUPTED_RUN)
    seconds: float | None = key(None, "seconds of optimisation; overrides steps; null = none", above(0))
    psnr: float | None = key(
        None, "stop at this PSNR, in dB; with strokes=auto, the PSNR to reach; null = none", at_least(0)
    )
    early_stop: float | None = key(None, "stop when 100 evaluations gain less, in dB; null = never", at_least(0))
    checkpoint_every: float | None = key(60, "seconds between checkpoints; null = only when interrupted", at_least(0))
    frames: int = key(60, "frames of the timelapse; 0 = no timelapse", between(0, 2000))
    frame_side: int = key(720, "longer side of these frames in pixels", between(2, 4096))
    timelapse: str = key("mp4", "format of the timelapse: mp4 or gif", one_of("mp4", "gif"))
    timelapse_seconds: float | None = key(None, "length of the timelapse in seconds; null = 15 frames/s", above(0))
    report: bool = key(True, "write report.html: the run on one page, with a replay of the painting")
    focus: str | None = key(None, "weights of errors: auto (saliency) or a mask, bright = important; null = 1", FOCUS)
    focus_strength: float = key(8, "weight of errors in the focus, relative to those elsewhere", between(1, 1000))
    faces: str = key(
        "auto",
        "auto = find faces, weigh them most in focus=auto, and paint eyes and mouths with small strokes; a mask, "
        "bright = also a face; off",
        FACES,
    )
    light: Lamp = field(default_factory=Lamp)
    style: StyleTransfer = field(default_factory=StyleTransfer)
    trainer: TrainerOptions = field(default_factory=TrainerOptions)


@dataclass
class ExportTask(Task):
    """Write a saved painting as pictures of any size, vectors, tables and more: to=png,svg,json,csv."""

    module = "brushexp.tasks.export"
    alone = "catalogue"
    check = staticmethod(rules.check_export)
    groups: ClassVar[dict[str, Any]] = {"to": ["png"], "renderer": None, "blend": "tiled"}

    catalogue: str = key(MISSING, "folder of a run, its catalogue.h5, or a strokes.json of to=json", CATALOGUE)
    resolution: int | None = key(None, "longer side in pixels; null = as it was painted", between(1, 65536))
    output: str = key(BESIDE_PAINTING, "folder of the files (beside their painting), or of all exports of a sweep")
    light: OtherLamp = field(default_factory=OtherLamp)
