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

    image: str | None = key(None, "a painting, file or sample: paint the picture in its style; null = off", PICTURE)
    brushwork: str | None = key(None, "catalogue.h5 of a painting: with strokes like its own; null = off", CATALOGUE)
    content: float = key(0.5, "factor of the weights of loss= while style.image is set", at_least(0))
    colors: str = key(
        "style", "of the painting: those of the style picture, or of the content", one_of("style", "content")
    )


@dataclass
class Lamp:
    """Keys below ``light`` of ``task=paint``; light=315,45 is short for light.azimuth=315 light.elevation=45."""

    depth: float = key(Light.depth, "thickness of the paint in the light; 1 is natural, 0 = no light", BOUNDS["depth"])
    azimuth: float = key(Light.azimuth, "of the lamp, degrees clockwise from the top; 315: upper left")
    elevation: float = key(Light.elevation, "of the lamp above the canvas, degrees", BOUNDS["elevation"])
    gloss: float = key(Light.gloss, "of the paint, 0 (matt) to 1 (wet)", BOUNDS["gloss"])


@dataclass
class OtherLamp:
    """Keys below ``light`` of ``task=export``, as in ``task=paint``."""

    depth: float | None = key(None, "thickness of the paint, 0 = no light; null = as painted", BOUNDS["depth"])
    azimuth: float | None = key(None, "of the lamp, degrees clockwise from the top; null = as painted")
    elevation: float | None = key(None, "of the lamp, degrees; null = as painted", BOUNDS["elevation"])
    gloss: float | None = key(None, "of the paint, 0 to 1; null = as painted", BOUNDS["gloss"])


@dataclass
class TrainerOptions:
    """Keys below ``trainer``: options of Lightning's Trainer, as its manual has them; what is null is left to it."""

    profiler: str | None = key(None, "where the time went, at the end", one_of("simple", "advanced"))
    precision: str = key("32-true", "bf16-mixed: networks compute in 16 bits", one_of(*PRECISIONS))
    max_epochs: int | None = key(-1, "a task ends by its own limits", at_least(-1))
    min_epochs: int | None = key(None, "passes before anything ends the fit", at_least(0))
    max_steps: int = key(-1, "gradient steps; -1 = no limit", at_least(-1))
    min_steps: int | None = key(None, "gradient steps before anything ends the fit", at_least(0))
    max_time: str | None = key(None, "of wall time, days:hours:minutes:seconds", DURATION)
    limit_train_batches: int | float | None = key(None, "of an epoch: a number, or a share as 0.5", at_least(0))
    limit_val_batches: int | float | None = key(None, "of a validation: a number, or a share as 0.5", at_least(0))
    val_check_interval: int | float | None = key(None, "batches, or share of an epoch, to a validation", above(0))
    check_val_every_n_epoch: int | None = key(None, "epochs between validations", at_least(1))
    log_every_n_steps: int = key(1, "steps between written values, in painting at least 0.25 s", at_least(1))
    accumulate_grad_batches: int | None = key(None, "batches of a gradient step", at_least(1))
    gradient_clip_val: float | None = key(None, "the largest gradient, see gradient_clip_algorithm", above(0))
    gradient_clip_algorithm: str | None = key(None, "of what: norm or value", one_of("norm", "value"))
    detect_anomaly: bool | None = key(None, "find the operation that made a NaN; slow")
    deterministic: bool | None = key(None, "refuse operations whose bits differ from run to run")
    benchmark: bool | None = key(None, "let cuDNN look for the fastest convolutions")
    enable_progress_bar: bool = key(False, "Lightning's own, beside ours")
    enable_model_summary: bool = key(False, "layers and parameters, at the start")
