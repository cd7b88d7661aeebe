"""Base class for metrics, which measure the quality of a finished painting."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from torch import Tensor

from brushexp.plugins.export.base import ExportJob
from brushexp.strokes.catalogue import Strokes

STANDARD = ("psnr", "psnr_focus", "ssim", "l1", "edges", "perceptual")  # default metrics, the first in tables


@dataclass(frozen=True)
class Comparison:
    """A finished painting and its target."""

    image: Tensor  # (3, H, W) the painting as saved: display-referred RGB in [0, 1], in steps of 1/255
    target: Tensor  # (3, H, W) the target in the same form
    focus: Tensor | None = None  # (H, W) weights of the pixels; None for equal weights
    strokes: Strokes | None = None  # strokes of the painting; None for other pictures
    job: ExportJob | None = None  # job that draws ``image``, without light and paper; None for other pictures


class Metric(ABC):
    """Measures the quality of a finished painting.

    Class attributes define how the metric is shown in tables, plots and pages, which list it after the metrics in
    `STANDARD`. The page report.html explains the metric with the first line of its docstring.

    >>> import torch
    >>> class Brightness(Metric):
    ...     '''Difference in mean brightness.'''
    ...     title, higher_is_better = "brightness", False
    ...     def __call__(self, comparison):
    ...         return float((comparison.image.mean() - comparison.target.mean()).abs())
    >>> Brightness()(Comparison(torch.ones(3, 4, 6), torch.zeros(3, 4, 6)))
    1.0
    """

    title: ClassVar[str]  # name in tables and plots
    variants: ClassVar[Mapping[str, str]] = {}  # label -> title, for a metric with several labels
    unit: ClassVar[str] = ""
    digits: ClassVar[int] = 4  # digits after the decimal point
    higher_is_better: ClassVar[bool]
    matters: ClassVar[float] = 0.0  # smallest difference between two settings that counts
    needs: ClassVar[tuple[str, ...]] = ()  # fields of `Comparison` without which the metric is omitted
    label: str = ""  # name in metrics.json, if it differs from that of the plugin
    remarks: Mapping[str, str | float] = {}  # further entries of metrics.json, available after a call
    files: Mapping[str, bytes] = {}  # files for the run's folder, by name, available after a call

    @abstractmethod
    def __call__(self, comparison: Comparison) -> float | None:
        """Compute the metric, which is best if the pictures are equal; return None if it is undefined for them."""

    @classmethod
    def facts(cls) -> dict[str, str]:
        return {"better": "higher" if cls.higher_is_better else "lower", "needs": ", ".join(cls.needs)}
