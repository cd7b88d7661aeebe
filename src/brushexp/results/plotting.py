"""What all plots of a report share: colours, letters, axes. Matplotlib is loaded when one is drawn."""

from __future__ import annotations

import io
import math
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from brushexp.system.files import write_bytes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Okabe and Ito (2008): told apart by the colour-blind too; without yellow, which is faint on white.
COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
MARKERS = "osD^vPX"
DASHES = ("-", "--", ":", "-.")
INK, FAINT, BAND = "#202020", "#d8d8d8", "#f5f5f5"
DPI = 100
SIZE = (14.0, 5.0)  # inches
WIDE = 20.0  # largest over smallest number from which an axis is logarithmic
BREAKS = "+,/_=-."  # signs after which a long word may be broken
NAMES = {
    **{"psnr": "PSNR, dB", "psnr_alpha": "PSNR of alpha, dB", "psnr_color": "PSNR of colour, dB", "ssim": "SSIM"},
    **{
        "l1": "L1",
        "l2": "L2",
        "edges": "error of edges",
        "perceptual": "perceptual distance",
        "seconds": "optimisation, s",
    },
    **{"lpips_alexnet": "LPIPS (AlexNet)", "lpips_squeeze": "LPIPS (SqueezeNet)", "lpips_vgg16": "LPIPS (VGG16)"},
    **{"fid_effl0": "FID (effl0)", "kid_effl0": "KID (effl0)", "fid_inception": "FID (Inception)"},
}


def new_figure(height: float = SIZE[1]) -> Figure:
    """An empty figure on white, of no global state."""
    from matplotlib.figure import Figure  # noqa: PLC0415

    return Figure(figsize=(SIZE[0], height), dpi=DPI, layout="constrained", facecolor="white")


def tidy(axes: Axes) -> None:
    """A light grid and no frame."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color("#808080")
    axes.grid(color=FAINT, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=9, color="#808080", labelcolor=INK)


def save(figure: Figure, path: Path) -> None:
    """Write a PNG, the same for the same figure."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # noqa: PLC0415

    encoded = io.BytesIO()
    FigureCanvasAgg(figure).print_png(encoded, metadata={"Software": None})  # figure.savefig draws twice
    write_bytes(path, encoded.getvalue())


def is_wide(values: Iterable[float]) -> bool:
    """Whether positive numbers differ so much that only a logarithmic axis shows them all."""
    found = list(values)
    return bool(found) and min(found) > 0 and max(found) / min(found) > WIDE


def fit_scale(axes: Axes, name: str, values: Iterable[float]) -> None:
    """A logarithmic axis (x or y) with plain numbers where values differ much."""
    from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter  # noqa: PLC0415

    if is_wide(values):
        axes.set(**{f"{name}scale": "log"})
        axis = axes.xaxis if name == "x" else axes.yaxis
        axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axis.set_minor_formatter(NullFormatter())


def as_number(text: str) -> float | None:
    """The number that a text says; None if it says none."""
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def named(words: Mapping[str, Mapping[str, str]], chosen: Sequence[str]) -> str:
    """A combination of settings: the value alone where only one setting varies.

    Args:
        words: setting -> value -> how that is shown.
        chosen: a value of each.
    """
    values = [words[key][value] or "not set" for key, value in zip(words, chosen, strict=True)]
    return ", ".join(values if len(values) == 1 else [f"{key}={v}" for key, v in zip(words, values, strict=True)])


def plain(text: str) -> str:
    """On one line, with the letters that the font has; a dollar sign begins no formula."""
    from matplotlib.font_manager import FontProperties, findfont, get_font  # noqa: PLC0415

    known = get_font(findfont(FontProperties())).get_charmap()
    return "".join(sign if ord(sign) in known else "?" for sign in " ".join(text.split())).replace("$", r"\$")


def wrapped(text: str, width: int, most: int = 3) -> str:
    """In lines of so many letters, broken after a sign if possible; what is left of the last is cut."""
    pieces = [""]
    for letter in plain(text):
        pieces[-1] += letter
        if letter in BREAKS:
            pieces.append("")
    lines = [""]
    for piece in [part for whole in pieces for part in textwrap.wrap(whole, width, drop_whitespace=False)]:
        if lines[-1] and len(lines[-1]) + len(piece) > width:
            lines.append("")
        lines[-1] += piece
    kept = [line.strip() for line in lines[:most]]
    if len(lines) > most:
        kept[-1] = kept[-1][: width - 3] + "..."
    return "\n".join(kept)


def spaced(places: Sequence[float], widths: Sequence[float]) -> list[int]:
    """Numbers of the labels that fit beside each other, from the first on.

    Args:
        places: middle of each label, as a fraction of the axis, rising.
        widths: of each label, likewise.
    """
    kept: list[int] = []
    for k, (place, width) in enumerate(zip(places, widths, strict=True)):
        if not kept or place - places[kept[-1]] >= (width + widths[kept[-1]]) / 2:
            kept.append(k)
    return kept
