"""Create a painting's slower files, such as prints and layered files, in threads, and report their progress."""

import zipfile
from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Protocol

from brushexp.contracts import UserError
from brushexp.contracts.families import ExportJob
from brushexp_studio.plans import Plan
from brushexp_studio.prints import Print

PRINTS = "print"  # name of the folder of these files in the painting's folder
MAKING, MADE, BROKEN = "making", "made", "broken"


class Painted(Protocol):
    """A finished painting with its files, from which further files can be made."""

    folder: Path
    painting: Any  # a `brushexp.Painting`, or None if it was not kept

    @property
    def name(self) -> str:
        """The stem of the names under which files are saved."""

    @property
    def ratio(self) -> float:
        """The ratio of width to height."""

    @property
    def files(self) -> dict[str, Path]:
        """The painting's files by name."""

    @property
    def has_tubes(self) -> bool:
        """Whether the painting uses real paints."""


@dataclass(frozen=True)
class Form:
    """A type of file that is made on request."""

    title: str  # label of its button
    what: str  # description in one line
    is_print: bool = False  # whether it has a size on paper
    draws: int | None = 1  # number of times that the picture is drawn; None if unknown in advance


FORMS = {
    "psd": Form("PSD", "layers for Photoshop and Affinity, from broad to fine strokes", draws=11),
    "ora": Form("ORA", "the same layers, for Krita and GIMP", draws=11),
    "plan": Form("Plan", "mixtures, the order of painting, and a drawing for painting by numbers", draws=None),
    "zip": Form("Everything, zip", "all files of the painting in one archive"),
    "pdf": Form("PDF to print", "one page of this size, for your printer or a print shop", is_print=True),
    "png": Form("PNG to print", "a crisp picture of this size", is_print=True),
}


def possible_forms(work: Painted) -> dict[str, Form]:
    """Return the kinds of files that can be made from a painting; PSD needs an extra, and a plan needs real paints."""
    missing = {"psd"} if find_spec("psd_tools") is None else set()
    if not work.has_tubes:
        missing.add("plan")
    return {key: form for key, form in FORMS.items() if key not in missing}


@dataclass
class Download:
    """A file that has been made, is being made, or could not be made."""

    form: str
    choice: Print | Plan | None = None  # the visitor's choice of size or difficulty
    status: str = MAKING
    share: float | None = 0.0  # finished share of the work, 0 to 1; None if unknown
    path: Path | None = None  # path of the finished file
    trouble: str = ""  # reason for a failure in one line

    @property
    def words(self) -> str:
        """The progress as text.

        >>> Download("pdf", share=0.4).words
        'Making the PDF … 40 %'
        """
        name = self.form if self.form in ("zip", "plan") else self.form.upper()
        share = "" if self.share is None else f" {100 * self.share:.0f} %"
        return f"Making the {name} …{share}"


@dataclass(frozen=True)
class WatchedJob(ExportJob):
    """An export job that calls ``watch`` with the fraction of the picture that each finished band covers."""

    watch: Callable[[float], None] = field(default=lambda share: None, kw_only=True)

    def bands(self, flat=None):  # type: ignore[no-untyped-def]
        for top, band in super().bands(flat):
            yield top, band
            self.watch(band.shape[1] / self.size[0])


class Stopped(Exception):
    """Raised when the studio closes while a file is being made."""


def make_file(work: Painted, download: Download, tell: Callable[[float | None], None]) -> Path:
    """Make a file of a finished painting and return its path.

    ``tell`` receives the progress. Raises UserError if the file cannot be made.
    """
    folder = work.folder / PRINTS
    folder.mkdir(parents=True, exist_ok=True)
    if download.form == "zip":
        return zip_files(work, folder / f"{work.name}.zip", tell)
    if work.painting is None:
        raise UserError("this painting was not kept; paint it again")
    finished, draws, drawn = work.painting.finished, FORMS[download.form].draws, 0.0

    def watch(share: float) -> None:
        nonlocal drawn
        if draws is None:
            tell(None)
        else:
            drawn += share / draws
            tell(min(1.0, drawn))

    parts = {part.name: getattr(finished.job, part.name) for part in fields(finished.job)}
    painting = replace(work.painting, finished=replace(finished, job=WatchedJob(**parts, watch=watch)))
    options = {} if download.choice is None else download.choice.options(work.ratio)
    return Path(painting.export(download.form, folder, **options)[0])


def zip_files(work: Painted, path: Path, tell: Callable[[float], None]) -> Path:
    """Pack all of a painting's files into a ZIP archive, and report the fraction of bytes packed so far to ``tell``."""
    files = work.files
    total = max(1, sum(file.stat().st_size for file in files.values()))
    packed = 0
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, file in files.items():
            archive.write(file, Path(work.name) / name)
            packed += file.stat().st_size
            tell(packed / total)
    return path


def describe_file(path: Path, size: tuple[int, int]) -> str:
    """Describe the type and size of a painting's file in one line; ``size`` is the painting's (H, W) in pixels."""
    megabytes = path.stat().st_size / 1e6
    amount = f"{megabytes:.1f}\u00a0MB" if megabytes >= 0.1 else f"{1000 * megabytes:.0f}\u00a0kB"
    if path.suffix == ".svg":
        with path.open(encoding="utf-8") as file:
            is_sprites = "bitmap with its texture" in file.read(2000)  # its description says so
        kind = "of bitmaps for the bristles" if is_sprites else "a path for each stroke"
        return f"vector file; {amount}, {kind}"
    what = {
        ".png": f"{size[1]} × {size[0]} pixels",
        ".h5": "the strokes as numbers, for brushexp",
        ".mp4": "how the painting was made",
        ".gif": "how the painting was made",
        ".html": "the painting and its strokes on one page, for any browser",
    }[path.suffix]
    return f"{what}; {amount}"
