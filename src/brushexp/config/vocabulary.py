"""The words that a painter types beside keys, and other spellings of ours; nothing here is slow to import."""

import os
import re
from importlib.metadata import entry_points
from pathlib import Path

PACKAGE = Path(__file__).parents[1]
SHIPPED = PACKAGE / "conf"
TASK_POINTS = "brushexp.tasks"  # entry-point group: name of a task -> its class
WORDS = {  # what a painter types -> what it means
    "finer": "detail=2",
    "bolder": "detail=0.25",
    "abstract": "abstraction=0.7",
    **{f"{key}={no}": "frames=0" for key in ("timelapse", "film") for no in ("none", "null", "no", "false")},
}
KEYS = {  # names that others have for a key of ours
    **dict.fromkeys(("time", "duration"), "seconds"),
    **dict.fromkeys(("size", "width", "height", "side", "pixels"), "resolution"),
    **dict.fromkeys(("iterations", "iters", "epochs"), "steps"),
    **dict.fromkeys(("out", "folder", "save", "output_dir", "destination"), "output"),
    **dict.fromkeys(("input", "photo", "picture", "file", "path"), "image"),
    **dict.fromkeys(("gpu", "cuda", "accelerator"), "device"),
    **dict.fromkeys(("medium", "filter"), "look"),
    **dict.fromkeys(("brushes", "n_strokes", "num_strokes", "brush_strokes"), "strokes"),
    **dict.fromkeys(("cores", "cpus", "jobs", "n_jobs"), "threads"),
    **dict.fromkeys(("canvas", "canvas_color", "bg", "ground"), "background"),
    "learning_rate": "lr",
    **dict.fromkeys(("fps", "frame_rate", "framerate"), "film.every"),
    **dict.fromkeys(("format", "export"), "to"),
}
PRINT = "brushexp export FOLDER to=png to.png.size_cm=60x40 to.png.dpi=300, with the FOLDER of a painting"
INSTEAD = {  # names that others have for what is said here with other keys, and what to type
    **dict.fromkeys(("dpi", "ppi", "cm", "inch", "inches", "print", "print_size", "paper_size"), PRINT),
    **dict.fromkeys(
        ("brush_size", "brush_width", "stroke_size", "stroke_width", "thickness"),
        "strokes=300 for few large ones, or detail=2 for smaller ones",
    ),
    **dict.fromkeys(("speed", "fast"), "quality=draft, or seconds=10"),
    **dict.fromkeys(
        ("colors", "n_colors", "num_colors", "palette_size"),
        "palette=toned palette.values=5 for few tones, "
        "or palette=picture palette.image=FILE for the colours of another picture",
    ),
    **dict.fromkeys(("fps", "frame_rate", "framerate"), "timelapse_seconds=10, in which frames=60 pictures are shown"),
    **dict.fromkeys(("video", "movie", "animation"), "timelapse=mp4, frames=60 and timelapse_seconds=10"),
    # options of Lightning's Trainer
    **dict.fromkeys((f"trainer.{name}" for name in ("accelerator", "devices", "strategy", "num_nodes")), "device=cpu"),
    **dict.fromkeys((f"trainer.{name}" for name in ("fast_dev_run", "overfit_batches")), "steps=3"),
    "trainer.logger": "logger=csv",
    "trainer.callbacks": "callbacks=early_stopping",
    "trainer.default_root_dir": "output=FOLDER",
    "trainer.enable_checkpointing": "checkpoint_every=null",
}
MEMBERS = {  # names that others have for a member of a family, a look or a quality
    **dict.fromkeys(("fast", "quick", "low", "preview"), "draft"),
    **dict.fromkeys(("high", "slow"), "fine"),
    **dict.fromkeys(("highest", "ultra", "max"), "best"),
    **dict.fromkeys(("medium", "standard", "default"), "normal"),
    **dict.fromkeys(("acrylic", "tempera", "poster"), "gouache"),
    **dict.fromkeys(("pencil", "charcoal", "pen", "sketch", "drawing", "line"), "ink"),
    **dict.fromkeys(("chalk", "crayon"), "pastel"),
    **dict.fromkeys(("knife", "palette_knife", "thick"), "impasto"),
    **dict.fromkeys(("pointillism", "seurat", "dots"), "pointillist"),
    **dict.fromkeys(("impressionist", "impressionism", "monet", "oil_paint", "oil_painting", "oils"), "oil"),
    **dict.fromkeys(("van_gogh", "gogh", "starry_night"), "vangogh"),
    **dict.fromkeys(("tif", "tiff", "bmp", "webp", "image"), "png"),
    "jpeg": "jpg",
    **dict.fromkeys(("mp4", "gif", "film", "video", "movie", "mov"), "process"),
    **dict.fromkeys(("print", "paper"), "pdf"),
    **dict.fromkeys(("eps", "ai", "vector", "dxf"), "svg"),
    **dict.fromkeys(("nc", "ngc", "cnc", "plotter"), "gcode"),
    "plt": "hpgl",
    **dict.fromkeys(("psd", "kra", "xcf", "layers", "openraster"), "ora"),
}
ALONE = ("look", "quality")  # groups whose members may stand alone: watercolour is look=watercolour


def members_alone() -> dict[str, str]:
    """Map each look and each quality, those that ship and those of ``conf/``, to what it means as a word alone."""
    return {name: f"{group}={name}" for group in ALONE for name in members_of_group(group)}


def meaning_of(word: str) -> str | None:
    """Return what a painter's word means, as key=value; None for other words.

    >>> meaning_of("finer"), meaning_of("watercolor"), meaning_of("photo.jpg")
    ('detail=2', 'look=watercolour', None)
    """
    known = WORDS | members_alone()
    return known.get(word) or known.get(respelt(word))


def members_of_group(group: str) -> set[str]:
    """List the presets of a group, those that ship and those of ``conf/``."""
    return {path.stem for root in (SHIPPED, Path("conf")) for path in (root / group).glob("*.yaml")}


def respelt(text: str) -> str:
    """Spell colour, grey, optimiser and analyse the other way, British or American.

    >>> respelt("watercolor"), respelt("style.colours"), respelt("grey")
    ('watercolour', 'style.colors', 'gray')
    >>> respelt("optimiser"), respelt("renderer.normalization"), respelt("analyze"), respelt("noise")
    ('optimizer', 'renderer.normalisation', 'analyse', 'noise')
    """
    pairs = {"colour": "color", "color": "colour", "grey": "gray", "gray": "grey"}
    pairs |= {"is": "iz", "iz": "is", "lys": "lyz", "lyz": "lys"}
    return re.sub("colour|color|grey|gray|i[sz](?=er|ation)|ly[sz](?=e)", lambda found: pairs[found[0]], text)


def as_task(word: str) -> str:
    """Spell a word of a command line as we do if it then is a task.

    >>> as_task("analyze"), as_task("task=analyze"), as_task("optimiser")
    ('analyse', 'task=analyse', 'optimiser')
    """
    spelt = respelt(word)
    return spelt if spelt != word and spelt.removeprefix("task=") in task_names() and not is_path(word) else word


def task_names() -> set[str]:
    """List the tasks by their names, without their classes."""
    own = {path.stem for path in (PACKAGE / "tasks").glob("[a-z]*.py")}
    return own | {point.name for point in entry_points(group=TASK_POINTS)}


def is_path(text: str) -> bool:
    """Whether a text is the path of a file or folder that exists."""
    return bool(text) and os.path.exists(os.path.expanduser(text))


def plain_name(name: str) -> str:
    """Write a name as the tables here have it.

    >>> plain_name("Brush-Size"), plain_name("colours")
    ('brush_size', 'colors')
    """
    name = re.sub("[- ]", "_", name.lower())
    return name if name in KEYS or name in INSTEAD else respelt(name)
