"""Turn a command line that names many pictures (``image=photos/``, ``image='photos/*.jpg'``) into a sweep."""

import glob
import logging
import os
import re
from collections import Counter
from collections.abc import Sequence
from importlib.util import find_spec
from itertools import chain, count
from pathlib import Path

from brushexp.config.compose import files_of, quote
from brushexp.config.vocabulary import is_path
from brushexp.config.words import verbatim
from brushexp.errors import UserError
from brushexp.pictures.folders import is_several, pictures_in, skipped_files
from brushexp.pictures.load import PICTURE as READABLE
from brushexp.pictures.load import samples
from brushexp.registry import literal
from brushexp.results.runs import JOBS
from brushexp.runs.sweep_jobs import PICTURE
from brushexp.system.published import entry_points_of
from brushexp.system.reading import digest_of, read_text, yaml_of
from brushexp.system.spellings import find_path

log = logging.getLogger(__name__)
SETS = "pictures="
LAUNCHERS = "brushexp.launchers"  # entry-point group: launcher -> function that checks whether it works here
ENDING = ".yaml"  # extension of files that list pictures
PROCESSES, AUTO = "jobs=", "auto"  # key for the number of jobs that run at once
LAUNCHER_WORDS = ("hydra/launcher=", "experiment=")  # words that choose a launcher, or may
PICTURES_PER_PROCESS = 2  # minimum
MB_PER_PROCESS = 2048  # memory of a process: 450 MB for modules, and about 800 bytes for each pixel


def expand_jobs(words: Sequence[str], pictures: int = 0) -> list[str]:
    """Replace ``jobs=2`` with a launcher that runs two jobs in parallel; several ``pictures`` imply ``jobs=auto``."""
    typed = [word for word in words if word.startswith(PROCESSES)]
    others = [word for word in words if word not in typed]
    automatic = pictures and not any(word.startswith(LAUNCHER_WORDS) for word in words)
    number = (typed or [PROCESSES + (AUTO if automatic else "1")])[-1].removeprefix(PROCESSES)
    if number == AUTO:
        number = str(parallel_limit(pictures))
    if not number.isdecimal() or number == "0":
        raise UserError(f"{typed[-1]} is not a number of processes; try jobs=2, or jobs=auto")
    return others if number == "1" else [*others, f"hydra/launcher={launcher()}", f"hydra.launcher.n_jobs={number}"]


def launcher() -> str:
    """Choose the launcher for parallel jobs: a package's own if it works on this machine, otherwise Hydra's joblib."""
    suiting = (name for name, works_here in entry_points_of(LAUNCHERS).items() if works_here.load()())
    return next(suiting, "joblib")


def parallel_limit(pictures: int) -> int:
    """Compute the maximum number of parallel processes from cores, memory and any ``pictures``; 1 on a GPU."""
    from brushexp.system.device import device_of  # noqa: PLC0415  (torch; --help should not wait for it)
    from brushexp.system.runtime import cores, free_memory  # noqa: PLC0415

    is_installed = launcher() != "joblib" or find_spec("hydra_plugins.hydra_joblib_launcher")
    if not is_installed or device_of("auto").type != "cpu":
        return 1
    work = pictures // PICTURES_PER_PROCESS if pictures else cores()
    return max(1, min(cores(), int(min(free_memory() / MB_PER_PROCESS, work))))


def expand_pictures(words: Sequence[str], is_sweep: bool) -> list[str]:
    """Turn a command line with several pictures into a sweep; repeating the command resumes the sweep."""
    named = [word.removeprefix(PICTURE) for word in words if word.startswith(PICTURE)]
    sets = [_without_brackets(word.removeprefix(SETS)) for word in words if word.startswith(SETS)]
    if not sets and len(named) < 2 and not any(map(is_several, named)):
        return expand_jobs(words)
    for image in named:
        if not is_sweep and not is_several(image) and not is_path(image):
            refuse_missing(image)
    counts = [len(pictures_in(image)) if is_several(image) else 1 for image in named]  # UserError if there are none
    pictures = 0 if sets or is_sweep else sum(counts)
    others = expand_jobs([word for word in words if not word.startswith((PICTURE, SETS))], pictures)
    parts = [*named, *(part for text in sets for part in ([text] if os.path.exists(text) else text.split(",")))]
    texts = ",".join(quote(literal(part)) for part in parts)  # Hydra resolves the options of a sweeper twice
    typed = [word.removeprefix("output=") for word in others if word.startswith("output=")]
    first = parts[0] if len(parts) == 1 else sets[0].replace(",", "_") if sets else os.path.dirname(parts[0])
    output = typed[-1] if typed else f"outputs/{name_of(first or '.')}"
    replaced = any(re.fullmatch("overwrite=(true|yes|on|1)", word, re.IGNORECASE) for word in others)
    goes_on = (Path(output) / JOBS).is_file() and not replaced
    return [
        *([] if is_sweep else ["--multirun"]),
        *others,
        *([] if typed else [f"output={verbatim(output)}"]),
        f"hydra.sweeper.pictures=[{texts}]",
        "hydra.sweeper.lenient=true",
        *(["hydra.sweeper.resume=true"] if goes_on else []),
    ]


def refuse_missing(image: str) -> None:
    """Raise a UserError for a picture that is neither a file nor a sample; it may be meant as the place of results."""
    try:
        READABLE.check("image", image)
    except UserError as error:
        raise UserError(f"{error}; for a folder of results, type output=FOLDER") from error


def _without_brackets(text: str) -> str:
    """Rewrite a list ``[a.jpg,"b.jpg"]`` as ``a.jpg,b.jpg``, unless a file with exactly this name exists."""
    if not (text.startswith("[") and text.endswith("]")) or os.path.exists(text):
        return text
    return ",".join(part.strip().strip("\"'") for part in text[1:-1].split(","))


def all_pictures(names: Sequence[str], folders: Sequence[Path]) -> list[str]:
    """List all pictures named by ``pictures=``, without duplicates."""
    return list(dict.fromkeys(picture for name in names for picture in pictures_named(name, folders)))


def pictures_named(name: str, folders: Sequence[Path]) -> list[str]:
    """List the pictures named by one entry of ``pictures=``: a set, a folder, a pattern or a single picture.

    A set is a YAML file, ``pictures/<name>.yaml`` in a config folder or any given path, that lists samples and files.
    Paths are relative to the folder of the YAML file or to the current folder. A UserError names files that are missing
    or whose SHA-256 differs from the one in the set.
    """
    files = {key: path for folder in folders for key, path in files_of(folder, "pictures").items()}
    path = Path(os.path.expanduser(name)) if name.endswith(ENDING) else files.get(name)
    if path is None or (os.path.exists(name) and not name.endswith(ENDING)):
        return _pictures_in(name) if is_several(name) else [name]
    try:
        digests = read_set(path)
    except UserError as error:
        raise UserError(f"pictures={name}: {error}; list one picture per line, '- photo.jpg'") from error
    places = {one: _place_of(one, path.parent) for one in digests}
    missing = [one for one, place in places.items() if not place.is_file() and one not in samples()]
    if missing or not digests:
        what = f"has no {', '.join(missing)}; put such files beside {path}" if missing else "is empty; list pictures"
        what += ", or where you are," * bool(missing)
        raise UserError(f"pictures={name} {what} or give names of samples: {', '.join(sorted(samples()))}")
    for one, digest in digests.items():
        if digest and places[one].is_file() and digest_of(places[one]) != digest:
            raise UserError(
                f"pictures={name}: {places[one]} is not the file that {path} means, whose SHA-256 is {digest}"
            )
    return [str(place) if place.is_file() else one for one, place in places.items()]


def _pictures_in(name: str) -> list[str]:
    """List the pictures that are in a folder or match a pattern, and log the files that are skipped."""
    paths = pictures_in(name)
    for line in skipped_files(name):
        log.warning("image=%s: %s", name, line)
    return paths


def read_set(path: Path) -> dict[str, str]:
    """Read a set: map each picture to its SHA-256 (``- photo.jpg: 0ab3...``), or to "" if its line has none."""
    lines = yaml_of(read_text(path, "give a file with a list of pictures"), list)
    pairs = (next(iter(line.items())) if isinstance(line, dict) and len(line) == 1 else (line, "") for line in lines)
    return {str(name): str(digest) for name, digest in pairs}


def _place_of(picture: str, folder: Path) -> Path:
    beside, here = find_path(folder / os.path.expanduser(picture)), find_path(picture)
    return beside if beside.is_file() or not here.is_file() else here


def name_of(image: str) -> str:
    """Choose the name of the output folder for pictures given by a folder or a pattern."""
    folder = image if os.path.isdir(os.path.expanduser(image)) else glob.escape(image).partition("[")[0]
    name = Path(os.path.expanduser(folder)).resolve().name  # pathlib's version raises for ~nosuchuser
    return name.replace("${", "{") or "pictures"  # Hydra cannot write into a folder with ${ in its name


def subfolders_for(paths: Sequence[str]) -> list[str]:
    """Name a folder after each picture's stem; if names clash, append the file extension and, if needed, a number."""
    stems = ["".join(c if c.isalnum() or c in "-_." else "_" for c in Path(path).stem) for path in paths]
    endings = [Path(path).suffix.lower().replace(".", "_") for path in paths]
    often = Counter(stems)
    names = [stem if often[stem] == 1 else stem + ending for stem, ending in zip(stems, endings, strict=True)]
    folders: list[str] = []
    for name in names:
        numbered = (f"{name}_{k}" for k in count(2))
        folders.append(next(one for one in chain([name], numbered) if one not in folders))
    return folders
