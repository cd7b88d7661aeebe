"""What every metric receives and returns."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from torch import Tensor

from brushexp.strokes.catalogue import Strokes

STANDARD = ("psnr", "psnr_focus", "ssim", "l1", "edges", "perceptual")  # chosen by default, and first in tables


@dataclass(frozen=True)
class Comparison:
    """A finished painting beside its target."""

    image: Tensor  # (3, H, W) the painting as it is saved: display-referred RGB in [0, 1], in steps of 1/255
    target: Tensor  # (3, H, W) likewise, what it should look like
    focus: Tensor | None = None  # (H, W) how much each pixel counts; None if all count alike
    strokes: Strokes | None = None  # of the painting; None if nobody knows them, as of a picture from elsewhere


class Metric(ABC):
    """One number that says how good a finished painting is; nothing is optimised by it.

    Tables, plots and pages show it as its class attributes say, after those of `STANDARD`. The first line of the
    docstring explains it in report.html.

    >>> import torch
    >>> class Brightness(Metric):
    ...     '''Difference of the mean brightness.'''
    ...     title, higher_is_better = "brightness", False
    ...     def __call__(self, comparison):
    ...         return float((comparison.image.mean() - comparison.target.mean()).abs())
    >>> Brightness()(Comparison(torch.ones(3, 4, 6), torch.zeros(3, 4, 6)))
    1.0
    """

    title: ClassVar[str]  # its name for people
    variants: ClassVar[Mapping[str, str]] = {}  # label -> title, of a metric that has several
    unit: ClassVar[str] = ""
    digits: ClassVar[int] = 4  # after the point
    higher_is_better: ClassVar[bool]
    matters: ClassVar[float] = 0.0  # two settings that differ by less are alike in it
    needs: ClassVar[tuple[str, ...]] = ()  # fields of `Comparison` without which it is left out
    remarks: ClassVar[Mapping[str, str]] = {}  # what metrics.json says about it besides
    label: str = ""  # what metrics.json calls it; "" for the name it was chosen by

    @abstractmethod
    def __call__(self, comparison: Comparison) -> float | None:
        """The number, at its best for two equal pictures; None if pictures of this kind have none."""

    @classmethod
    def facts(cls) -> dict[str, str]:
        return {"better": "higher" if cls.higher_is_better else "lower", "needs": ", ".join(cls.needs)}
