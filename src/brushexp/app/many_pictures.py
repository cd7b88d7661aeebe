"""Many pictures: ``image=photos/``, or a pattern as ``image='photos/*.jpg'``, is a sweep over files in one process."""

import glob
import os
import shlex
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from brushexp.app.sweep_jobs import JOBS, SUBFOLDER
from brushexp.errors import UserError

PICTURES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".webp", ".bmp", ".gif")
IMAGE = "image="
PROCESSES = "jobs="  # of a sweep: how many at once


def in_processes(words: Sequence[str]) -> list[str]:
    """The words with ``jobs=2`` written out: a launcher that runs so many jobs of a sweep at once."""
    found = [word for word in words if word.startswith(PROCESSES)]
    if not found:
        return [*words]
    number = found[-1].removeprefix(PROCESSES)
    if not number.isdecimal() or number == "0":
        raise UserError(f"{found[-1]} is no number of processes; try jobs=2")
    kept = [word for word in words if word not in found]
    return kept if number == "1" else [*kept, "hydra/launcher=joblib", f"hydra.launcher.n_jobs={number}"]


def as_sweep(words: Sequence[str], is_sweep: bool) -> list[str]:
    """The words of a command line with a folder of pictures, or several, written out as a sweep; others as they are.

    Each picture has the subfolder of its name, unless something else is swept, too, or may be. The same command again
    goes on: finished pictures are kept.
    """
    named = [word.removeprefix(IMAGE) for word in words if word.startswith(IMAGE)]
    if len(named) < 2 and not any(map(is_several, named)):
        return [*words]
    paths = [path for image in named for path in (pictures_in(image) if is_several(image) else [image])]
    others = [word for word in words if not word.startswith(IMAGE)]
    numbered = is_sweep or any(word.startswith("experiment=") for word in others)  # which may sweep
    places = [""] * len(paths) if numbered else [f" {SUBFOLDER}{name}" for name in subfolders_for(paths)]
    settings = [shlex.quote(f"image={path}") + where for path, where in zip(paths, places, strict=True)]
    texts = ",".join('"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"' for text in settings)
    typed = [word.removeprefix("output=") for word in others if word.startswith("output=")]
    first = named[0] if len(named) == 1 else os.path.dirname(named[0])
    output = typed[-1] if typed else f"outputs/{name_of(first or '.')}"
    goes_on = (Path(output) / JOBS).is_file() and "overwrite=true" not in others
    return [
        *([] if is_sweep else ["--multirun"]),
        *others,
        *([] if typed else [f"output={output}"]),
        f"hydra.sweeper.settings=[{texts}]",
        "hydra.sweeper.lenient=true",
        *(["hydra.sweeper.resume=true"] if goes_on else []),
    ]


def is_several(image: str) -> bool:
    """Whether what was typed names a folder or, being no file, is a pattern."""
    path = os.path.expanduser(image)
    return os.path.isdir(path) or (not os.path.exists(path) and glob.has_magic(image) and "(" not in image)


def pictures_in(image: str) -> list[str]:
    """The picture files that a folder holds, or a pattern names; a UserError if there are none."""
    path = os.path.expanduser(image)
    found = glob.glob(os.path.join(glob.escape(path), "*") if os.path.isdir(path) else path, recursive=True)
    paths = sorted(name for name in found if name.lower().endswith(PICTURES) and os.path.isfile(name))
    if not paths:
        raise UserError(f"image={image}: no picture is there; give a folder or pattern of {', '.join(PICTURES)}")
    return paths


def name_of(image: str) -> str:
    """What to call the paintings of a folder or pattern."""
    folder = image if os.path.isdir(os.path.expanduser(image)) else glob.escape(image).partition("[")[0]
    return Path(folder).expanduser().resolve().name or "pictures"


def subfolders_for(paths: Sequence[str]) -> list[str]:
    """A folder for each picture: its name without its ending, and with it where two would have one."""
    stems = ["".join(c if c.isalnum() or c in "-_." else "_" for c in Path(path).stem) for path in paths]
    endings = [Path(path).suffix.lower().replace(".", "_") for path in paths]
    often = Counter(stems)
    names = [stem if often[stem] == 1 else stem + ending for stem, ending in zip(stems, endings, strict=True)]
    return [f"{name}_{names[:k].count(name) + 1}" if names[:k].count(name) else name for k, name in enumerate(names)]
