"""Draw the picture, its paintings, and maps that show how certain the measures of strokes are."""

from pathlib import Path
from typing import Any

import numpy as np
from brushexp_studies.plotting import FAINT, INK, new_figure, save_figure, without_math
from matplotlib import colormaps
from matplotlib.figure import Figure
from numpy.typing import NDArray
from torch import Tensor

from brushexp.contracts.files import to_bytes
from brushexp_predictor.samples.conformal import COVERAGE, RIGHT
from brushexp_predictor.samples.sampled import SampledBrushwork

Array = NDArray[Any]

PANEL = 4.1  # width of a picture in inches
TWICE = 2.0  # minimum upper end of the scale of sizes, as a factor
DASHES = 32  # number of dashes along the longer side
TITLES = {
    "direction": "directions: of 100 strokes, {} are within ± degrees",
    "length": "lengths: {} are within a factor of",
    "width": "widths: {} are within a factor of",
}


def certainty_of(brushwork: SampledBrushwork, name: str) -> Array:
    """Compute each interval's half-width (rows, columns), in degrees for directions and as a factor >= 1 for sizes."""
    one = brushwork.strokes[name]
    half: Array = 0.5 * (one.high - one.low) if name == "direction" else np.sqrt(one.high / one.low)
    return half


def write_figure(path: Path, brushwork: SampledBrushwork, name: str) -> Path:
    """Write a sheet (PNG) with the picture, its best painting and its worst painting above three maps."""
    height, width = brushwork.picture.shape[1:]
    figure = new_figure(2 * PANEL * height / width + 1.0)
    pictures, maps = figure.subplots(2, 3)
    by_psnr = sorted(brushwork.samples, key=lambda sample: -sample.psnr)
    shown = {
        f"{without_math(name)[:40]}, {width} x {height} px": brushwork.picture,
        f"best of {len(by_psnr)} paintings, {by_psnr[0].psnr:.2f} dB": by_psnr[0].painting,
        f"worst, {by_psnr[-1].psnr:.2f} dB": by_psnr[-1].painting,
    }
    for axes, (title, picture) in zip(pictures, shown.items(), strict=True):
        _frame(axes, title)
        axes.imshow(to_bytes(picture))
    for axes, (measure, title) in zip(maps, TITLES.items(), strict=True):
        _frame(axes, title.format(round(100 * COVERAGE)))
        _map(figure, axes, certainty_of(brushwork, measure), measure == "direction", (height, width))
    _dashes(maps[0], brushwork)
    return save_figure(figure, path)


def _frame(axes: Any, title: str) -> None:
    axes.set_title(title, fontsize=10)
    axes.set(xticks=[], yticks=[])
    axes.set_facecolor(FAINT)  # visible where samples are undefined


def _map(figure: Figure, axes: Any, half: Array, is_direction: bool, size: tuple[int, int]) -> None:
    """Draw a map of interval widths, with light colours where intervals are narrow."""
    finite = half[np.isfinite(half)]
    widest = RIGHT if is_direction else max(TWICE, float(np.quantile(finite, 0.98)) if len(finite) else TWICE)
    place = (0, size[1], size[0], 0)
    image = axes.imshow(half, extent=place, cmap=colormaps["YlGnBu"], vmin=0 if is_direction else 1, vmax=widest)
    scale = figure.colorbar(image, ax=axes, shrink=0.7)
    scale.ax.tick_params(labelsize=8)


def _dashes(axes: Any, brushwork: SampledBrushwork) -> None:
    """Draw dashes in the directions of strokes; the more certain a direction is, the longer its dash."""
    step = max(1, round(max(brushwork.places.shape[:2]) / DASHES))
    places: Tensor = brushwork.places[::step, ::step]
    way = np.radians(brushwork.strokes["direction"].value[::step, ::step])
    known = np.clip(1 - certainty_of(brushwork, "direction")[::step, ::step] / RIGHT, 0, 1)
    length = known * max(brushwork.picture.shape[1:]) / DASHES
    axes.quiver(
        places[..., 0], places[..., 1], length * np.cos(way), length * np.sin(way), color=INK, width=0.004,
        pivot="middle", angles="xy", scale_units="xy", scale=1, headwidth=0, headlength=0, headaxislength=0,
    )  # fmt: skip
