"""Describe the numbers in metrics.json: how tables, plots and pages show them, and whether higher is better."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from brushexp.plugins.metric.base import STANDARD
from brushexp.registry import Plugin, plugins


@dataclass(frozen=True)
class Quantity:
    """A numeric result of a run, as shown in tables, plots and pages."""

    title: str
    digits: int  # digits after the decimal point
    better: str  # "higher", "lower", or "" for neither
    matters: float = 0.0  # difference below which two values count as equal
    ratio: bool = False  # whether differences are computed between logarithms
    unit: str = ""
    about: str = ""

    @property
    def name(self) -> str:
        """Return the title with its unit, if any."""
        return f"{self.title}, {self.unit}" if self.unit else self.title

    @property
    def label(self) -> str:
        """Return the label for an axis: the name, and whether lower or higher is better."""
        return f"{self.name} ({self.better} is better)"


OTHERS: Mapping[str, Quantity] = {  # numbers of a run that do not come from metrics
    **{f"style_{kind}": Quantity(f"style {kind}", 4, "lower") for kind in ("poly", "linear", "gaussian", "meanstd")},
    "accuracy": Quantity("accuracy", 4, "higher"),
    "auc": Quantity("AUC", 4, "higher"),
    "l2": Quantity("L2", 6, "lower", 0.05, ratio=True),
    "psnr_decoded": Quantity(
        "PSNR of the decoded strokes",
        2,
        "higher",
        0.1,
        unit="dB",
        about="PSNR of the picture painted from the file whose bits are counted.",
    ),
    "psnr_alpha": Quantity("PSNR of alpha", 2, "higher", 0.1, unit="dB"),
    "psnr_color": Quantity("PSNR of colour", 2, "higher", 0.1, unit="dB"),
    "bristles_thick": Quantity("bristle energy, thick", 3, ""),
    "bristles_thin": Quantity("bristle energy, thin", 3, ""),
    "light_thick": Quantity("energy of light, thick", 3, ""),
    "fid_effl0": Quantity("FID (effl0)", 2, "lower", 0.05, ratio=True),
    "kid_effl0": Quantity("KID (effl0)", 2, "lower", 0.05, ratio=True),
    "fid_inception": Quantity("FID (Inception)", 2, "lower", 0.05, ratio=True),
    "strokes_per_second": Quantity("strokes per second", 0, "higher", 0.05, ratio=True),
    "strokes_per_second_backward": Quantity("strokes per second backward", 0, "higher", 0.05, ratio=True),
    "parameters": Quantity("parameters", 0, ""),
    "file_mb": Quantity("file", 2, "", unit="MB"),
    "seconds": Quantity("optimisation", 1, "lower", 0.1, ratio=True, unit="s"),
    "cpu_seconds": Quantity("CPU", 1, "lower", 0.1, ratio=True, unit="s"),
    "n": Quantity("strokes", 0, ""),
    "n_strokes": Quantity("strokes painted", 0, ""),
}


def quantities() -> dict[str, Quantity]:
    """Return all quantities by key, in the order of tables and plots: first the metrics, then the others."""
    rank = {name: place for place, name in enumerate(STANDARD)}
    ranked = sorted(plugins("metric"), key=lambda plugin: rank.get(plugin.name, len(rank)))
    return {key: quantity for plugin in ranked for key, quantity in _quantities_of(plugin).items()} | dict(OTHERS)


def _quantities_of(plugin: Plugin) -> dict[str, Quantity]:
    cls: Any = plugin.cls
    facts = cls.digits, "higher" if cls.higher_is_better else "lower", cls.matters, False, cls.unit, plugin.summary
    return {key: Quantity(title, *facts) for key, title in (cls.variants or {plugin.name: cls.title}).items()}


def digits() -> dict[str, int]:
    """Return the number of decimal places of each quantity."""
    return {key: quantity.digits for key, quantity in quantities().items()}
