"""Find the pictures that are in a folder or match a pattern such as ``photos/*.jpg``, and list the skipped files."""

import glob
import os
from collections import Counter
from collections.abc import Iterable
from functools import cache
from pathlib import Path

from brushexp.errors import UserError
from brushexp.pictures.kinds import FILM_SUFFIXES, FORMATS, RAW_SUFFIXES, WITH_CODECS, has_codec
from brushexp.system.spellings import both_forms

CODEC_SUFFIXES = {".heic": "heic", ".heics": "heic", ".heif": "heic", ".heifs": "heic", ".hif": "heic", ".jxl": "jxl"}
VECTORS = (".svg", ".svgz", ".pdf", ".eps", ".ps", ".ai")
PROJECT_SUFFIXES = (".xcf", ".kra", ".clip", ".ora", ".procreate", ".afphoto", ".exr", ".hdr")
NAMED = 3  # largest number of files of a kind that a line names


@cache
def picture_suffixes() -> frozenset[str]:
    """List the extensions, in lower case, of readable picture files."""
    from PIL import Image  # noqa: PLC0415  (the first words of the program do not need it)

    Image.init()
    codecs = {kind for kind, extra in WITH_CODECS.items() if has_codec(extra)}
    return frozenset(suffix for suffix, kind in Image.registered_extensions().items() if kind in {*FORMATS, *codecs})


def is_several(image: str) -> bool:
    """Check whether a value is a folder or a pattern, rather than a single file."""
    path = os.path.expanduser(image)
    return os.path.isdir(path) or (not os.path.exists(path) and glob.has_magic(image) and "(" not in image)


def pictures_in(image: str) -> list[str]:
    """List the picture files that are in a folder or match a pattern; raise a UserError if there are none."""
    paths = [name for name in _match_names(image) if _suffix(name) in picture_suffixes() and os.path.isfile(name)]
    if not paths:
        others = "; ".join(skipped_files(image)) or "give a folder or pattern of .png, .jpg, .tif, .webp, ..."
        raise UserError(f"image={image}: there are no pictures; {others}")
    return paths


def pictures_of(names: Iterable[str]) -> list[str]:
    """List pictures, expanding folders and patterns."""
    return [picture for name in names for picture in (pictures_in(name) if is_several(name) else [name])]


def skipped_files(image: str) -> list[str]:
    """Describe the files that `pictures_in` skips, in one line per type; hidden files are not mentioned."""
    names = [
        name for name in _match_names(image) if _suffix(name) not in picture_suffixes() or not os.path.isfile(name)
    ]
    kinds: dict[str, list[str]] = {}
    for name in names:
        kinds.setdefault(_cure_of(name, image), []).append(name)
    return [f"{_in_words(found)} left out: {cure}" for cure, found in kinds.items()]


def _match_names(image: str) -> list[str]:
    path = os.path.expanduser(image)
    patterns = {os.path.join(glob.escape(path), "*")} if os.path.isdir(path) else both_forms(path)
    return sorted({name for pattern in patterns for name in glob.glob(pattern, recursive=True)})


def _suffix(name: str) -> str:
    return Path(name).suffix.lower()


def _cure_of(name: str, image: str) -> str:
    """Explain what to do about a skipped file or folder."""
    suffix = _suffix(name)
    if os.path.isdir(name):
        inner = ("*", "*.jpg") if os.path.isdir(os.path.expanduser(image)) else ("*.jpg",)
        return f"to paint pictures in such folders, image='{os.path.join(image, *inner)}'"
    if not os.path.exists(name):
        return "these links are broken"
    if suffix in FILM_SUFFIXES:
        return "paint a film separately, image=clip.mp4"
    if suffix in CODEC_SUFFIXES:
        return f"they need a decoder, pip install 'brushexp[{CODEC_SUFFIXES[suffix]}]'"
    if suffix in RAW_SUFFIXES:
        return "develop raw photographs first"
    return (
        "save them as PNG first" if suffix in (*VECTORS, *PROJECT_SUFFIXES) else "they lack the extension of a picture"
    )


def _in_words(names: list[str]) -> str:
    """Name the files of a type or, if there are many, count them by extension."""
    if len(names) <= NAMED:
        return ", ".join(map(os.path.basename, names))
    counts = Counter("folders" if os.path.isdir(name) else _suffix(name) or "without an extension" for name in names)
    return ", ".join(f"{count} {suffix}" for suffix, count in sorted(counts.items()))
