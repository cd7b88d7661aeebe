"""The contract of metrics."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from torch import Tensor

from brushexp.plugins.export.base import ExportJob
from brushexp.strokes.catalogue import Strokes

STANDARD = ("psnr", "psnr_focus", "ssim", "l1", "edges", "perceptual")  # chosen by default, and first in tables


@dataclass(frozen=True)
class Comparison:
    """A finished painting and its target."""

    image: Tensor  # (3, H, W) the painting as it is saved: display-referred RGB in [0, 1], in steps of 1/255
    target: Tensor  # (3, H, W) likewise
    focus: Tensor | None = None  # (H, W) weights of the pixels; None for equal ones
    strokes: Strokes | None = None  # strokes of the painting; None for a picture from elsewhere
    job: ExportJob | None = None  # what draws ``image``, without light and paper; None for a picture from elsewhere


class Metric(ABC):
    """Measures the quality of a finished painting.

    Its class attributes say how tables, plots and pages show it, after those of `STANDARD`; report.html explains it by
    the first line of its docstring.

    >>> import torch
    >>> class Brightness(Metric):
    ...     '''Difference of the mean brightness.'''
    ...     title, higher_is_better = "brightness", False
    ...     def __call__(self, comparison):
    ...         return float((comparison.image.mean() - comparison.target.mean()).abs())
    >>> Brightness()(Comparison(torch.ones(3, 4, 6), torch.zeros(3, 4, 6)))
    1.0
    """

    title: ClassVar[str]  # its name in tables and plots
    variants: ClassVar[Mapping[str, str]] = {}  # label -> title, of a metric that has several
    unit: ClassVar[str] = ""
    digits: ClassVar[int] = 4  # after the point
    higher_is_better: ClassVar[bool]
    matters: ClassVar[float] = 0.0  # least difference of two settings that counts
    needs: ClassVar[tuple[str, ...]] = ()  # fields of `Comparison` without which it is omitted
    label: str = ""  # its name in metrics.json, if not that of the plugin
    remarks: Mapping[str, str | float] = {}  # further entries of metrics.json, once it has been called
    files: Mapping[str, bytes] = {}  # files that it measured, by name, for the run's folder, once it has been called

    @abstractmethod
    def __call__(self, comparison: Comparison) -> float | None:
        """Compute the metric, best for two equal pictures; None if it is undefined for these pictures."""

    @classmethod
    def facts(cls) -> dict[str, str]:
        return {"better": "higher" if cls.higher_is_better else "lower", "needs": ", ".join(cls.needs)}
