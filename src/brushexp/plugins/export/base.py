"""The contract of exporters, which write a painting into files."""

from abc import ABC, abstractmethod
from pathlib import Path

from brushexp.plugins.export.job import ExportJob
from brushexp.registry import plugins

__all__ = ["ExportJob", "Exporter"]


class Exporter(ABC):
    """Writes a painting in a form that other programs read.

    >>> class Sizes(Exporter):
    ...     def write(self, job: ExportJob, folder: Path) -> list[Path]:
    ...         (folder / "size.txt").write_text("{} x {}, {} strokes".format(*job.size, len(job.strokes)))
    ...         return [folder / "size.txt"]
    >>> import torch
    >>> from tempfile import TemporaryDirectory
    >>> from brushexp.plugins.export.job import export_job
    >>> from brushexp.strokes.prior import sample_prior
    >>> from brushexp.strokes.saved import Saved
    >>> strokes, depth = sample_prior(3), torch.arange(3, dtype=torch.int32)
    >>> job = export_job(Saved(strokes, depth, (24, 32), torch.ones(3), renderer="analytic"))
    >>> with TemporaryDirectory() as folder:
    ...     Sizes().write(job, Path(folder))[0].read_text()
    '24 x 32, 3 strokes'
    >>> [(top, tuple(band.shape)) for top, band in job.bands()]
    [(0, (3, 24, 32))]
    """

    @property
    def key(self) -> str:
        """The key of its options on the command line: ``to.`` and the registered name."""
        return next(plugin.path for plugin in plugins("to") if plugin.cls is type(self))

    def check(self, count: int, size: tuple[int, int]) -> None:  # noqa: B027  (most hold anything)
        """Raise a UserError if the form cannot hold ``count`` strokes on a canvas of ``size`` (H, W)."""

    @abstractmethod
    def write(self, job: ExportJob, folder: Path) -> list[Path]:
        """Write one or more files into ``folder`` and return their paths, the main one first.

        Nothing else is written, the job stays as it is, and the same job gives the same bytes (of a video, the same
        pictures). A painting without strokes is written, too; a UserError says why one cannot be written in this form.
        """
