"""Folders of many files leave an exporter as one file."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from zipfile import ZipFile, ZipInfo

from brushexp.system.files import replacing

EARLIEST = (1980, 1, 1, 0, 0, 0)  # date of all files in it, so that the same painting gives the same bytes


@contextmanager
def archive(path: Path) -> Iterator[Path]:
    """Yield a folder to write into, and pack it into a zip file at ``path``: whole, or not at all."""
    with TemporaryDirectory(prefix="brushexp-") as folder:
        yield Path(folder)
        with replacing(path) as temporary, ZipFile(temporary, "w") as packed:
            for file in sorted(Path(folder).rglob("*")):
                if file.is_file():
                    packed.writestr(ZipInfo(str(file.relative_to(folder)), EARLIEST), file.read_bytes())
