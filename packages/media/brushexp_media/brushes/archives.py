"""Extract brushes from archives: Procreate brushes (.brush, .brushset) and Krita bundles (.bundle)."""

import re
import zipfile
from collections.abc import Iterator
from io import BytesIO
from pathlib import PurePosixPath

from brushexp.contracts import UserError

SHAPES = {  # extension of an archive -> the brush files in it
    ".brush": re.compile(r"(?:[^/]+/)?Shape\.png"),
    ".brushset": re.compile(r"[^/]+/Shape\.png"),
    ".bundle": re.compile(r"brushes/(?:[^/]+/)*[^/]+\.(?:gbr|gih|abr|png)", re.IGNORECASE),
}
LARGEST_FILE = 64 * 2**20  # bytes of a brush in an archive
BUILT_IN = "names brushes that are built into its program and brings none; paint a stroke with it and save that as PNG"


def brushes_in(data: bytes, ending: str) -> Iterator[tuple[str, bytes]]:
    """Yield the name and content of each brush in an archive, whose file extension ``ending`` determines its type.

    Raises a UserError if the archive cannot be read or contains no brush.
    """
    try:
        with zipfile.ZipFile(BytesIO(data)) as archive:
            names = sorted(name for name in archive.namelist() if SHAPES[ending].fullmatch(name))
            if not names:
                raise UserError(BUILT_IN)
            for name in names:
                if archive.getinfo(name).file_size > LARGEST_FILE:
                    raise UserError(f"has a brush of more than {LARGEST_FILE >> 20} MB, {name}; leave that one out")
                yield _short(name), archive.read(name)
    except (zipfile.BadZipFile, zipfile.LargeZipFile, NotImplementedError, RuntimeError, EOFError, OSError) as error:
        raise UserError(f"is damaged, or no archive of brushes ({error}); save it anew from its program") from error


def _short(name: str) -> str:
    """Name a brush after its file in an archive or, for Procreate (always Shape.png), after its folder."""
    path = PurePosixPath(name)
    return f"{path.parent.name or 'brush'}.png" if path.name == "Shape.png" else path.name
