"""Keys below a key of a task, ``style.``, ``light.`` and ``trainer.``; `schema` has the tasks."""

from dataclasses import dataclass

from brushexp.bounds import DURATION, above, at_least, one_of
from brushexp.config.keys import key
from brushexp.config.rules import CATALOGUE
from brushexp.pictures.load import PICTURE
from brushexp.shading.light import BOUNDS, Light

PRECISIONS = ("32-true", "bf16-mixed", "16-mixed", "bf16-true", "16-true", "64-true", "32", "bf16", "16", "64")


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

    profiler: str | None = key(None, "log at the end where the time was spent; null = no", one_of("simple", "advanced"))
    precision: str = key("32-true", "precision; bf16-mixed = networks compute in 16 bits", one_of(*PRECISIONS))
    max_epochs: int | None = key(-1, "epochs at most; -1 = no limit (a task has limits of its own)", at_least(-1))
    min_epochs: int | None = key(None, "epochs at least", at_least(0))
    max_steps: int = key(-1, "gradient steps at most; -1 = no limit", at_least(-1))
    min_steps: int | None = key(None, "gradient steps at least", at_least(0))
    max_time: str | None = key(None, "limit of wall time, days:hours:minutes:seconds", DURATION)
    limit_train_batches: int | float | None = key(None, "batches per epoch: number or fraction as 0.5", at_least(0))
    limit_val_batches: int | float | None = key(None, "batches per validation: number or fraction as 0.5", at_least(0))
    val_check_interval: int | float | None = key(None, "batches between validations, or a fraction: 0.5", above(0))
    check_val_every_n_epoch: int | None = key(None, "epochs between validations", at_least(1))
    log_every_n_steps: int = key(1, "steps between logged values; in painting, at least 0.25 s", at_least(1))
    accumulate_grad_batches: int | None = key(None, "batches accumulated into a gradient step", at_least(1))
    gradient_clip_val: float | None = key(None, "clip gradients at this value; null = no clipping", above(0))
    gradient_clip_algorithm: str | None = key(None, "clip the norm of gradients, or values", one_of("norm", "value"))
    detect_anomaly: bool | None = key(None, "find the operation that produced a NaN; slow")
    deterministic: bool | None = key(None, "use deterministic operations only")
    benchmark: bool | None = key(None, "let cuDNN choose the fastest convolutions")
    enable_progress_bar: bool = key(False, "show Lightning's progress bar beside that of the program")
    enable_model_summary: bool = key(False, "print the layers and numbers of parameters at the start")
