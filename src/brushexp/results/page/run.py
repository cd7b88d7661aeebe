"""The page of a run, or of a catalogue alone: everything about one painting in one file."""

from __future__ import annotations

import csv
import logging
import math
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from brushexp.analysis.columns import StrokeTable, measure_strokes
from brushexp.errors import UserError
from brushexp.registry import plugins
from brushexp.results.page.charts import Chart, histogram_chart, line_chart, rose_chart
from brushexp.results.page.error_map import MAGMA, error_map
from brushexp.results.page.heights import height_map
from brushexp.results.page.html import page, picture_uri, readable_number
from brushexp.results.page.replay import recorded_config, replay_of
from brushexp.results.page.swatches import swatches_of
from brushexp.results.runs import UNREADABLE, command_of, read_result
from brushexp.strokes.storage import Saved, load_catalogue
from brushexp.system.files import write_text

log = logging.getLogger(__name__)
PAGE_NAME = "report.html"
PICTURES = {"target.png": "target", "painting.png": "painting", "style.png": "style", "focus.png": "focus"}
Picture = np.ndarray | Path  # (H, W, 3) uint8, or a file
METRICS_SHOWN = (  # of metrics.json: key, name, unit, digits, what it is
    ("psnr", "PSNR", "dB", 2, "peak signal-to-noise ratio, all pixels of the 8-bit pictures"),
    ("ssim", "SSIM", "", 3, "structural similarity (Wang et al., 2004); 1 is identical"),
    ("l1", "L1", "", 4, "mean |difference|, 0 to 1"),
    ("perceptual", "perceptual", "", 3, "distance in the features of a small network; 0 is identical"),
    ("psnr_focus", "PSNR in focus", "dB", 2, "of the mean squared error, weighted by the focus"),
    ("n_strokes", "strokes", "", 0, "in the catalogue"),
    ("steps", "steps", "", 0, "of gradient descent"),
    ("seconds", "optimisation", "s", 1, "wall time of the steps"),
)


def write_run_page(folder: Path) -> Path:
    """Write ``report.html`` into the folder of a run and return its path."""
    write_text(folder / PAGE_NAME, page_of_run(folder))
    return folder / PAGE_NAME


def page_of_run(folder: Path) -> str:
    """The page of a run, from what it has left in its folder; writes nothing.

    Raises:
        UserError: if there is no catalogue, or it is damaged.
    """
    saved = load_catalogue(folder / "catalogue.h5")
    metrics = read_result(folder / "metrics.json") if (folder / "metrics.json").is_file() else None
    image = recorded_config(saved.config).get("image")
    return run_page(
        saved,
        name=Path(str(image or folder.resolve().name)).name,
        pictures={name: folder / file for file, name in PICTURES.items() if _is_picture(folder / file)},
        metrics=metrics,
        curves=read_curves(folder / "curves" / "metrics.csv"),
        command=None if metrics is None else command_of(folder),
    )


def read_curves(path: Path) -> dict[str, list[float]] | None:
    """The columns of a table of curves, NaN where there is nothing; None if it is not there or no table."""
    try:
        with path.open(encoding="utf-8", newline="") as file:
            table = csv.DictReader(file)
            rows = list(table)
    except (OSError, UnicodeDecodeError, csv.Error):
        return None
    return {name: [_float(row[name]) for row in rows] for name in table.fieldnames or ()}


def run_page(
    saved: Saved,
    *,
    name: str,
    pictures: Mapping[str, Picture] | None = None,
    metrics: Mapping[str, Any] | None = None,
    curves: Mapping[str, Sequence[float]] | None = None,
    command: str | None = None,
) -> str:
    """The page of a painting, HTML that needs nothing else; a part of which nothing is known is left out.

    Args:
        saved: its catalogue.
        name: of the picture, a title.
        pictures: by name: ``target``, ``painting`` (without it there are no error map and no light), and others.
        metrics: as in metrics.json.
        curves: columns by name: ``step``, ``seconds``, ``psnr``, ``loss/...``.
        command: what repeats the run.
    """
    metrics = metrics or {}
    pixels = {key: _pixels(value) for key, value in (pictures or {}).items()}
    shown = {key: _for_template(value, pixels[key]) for key, value in (pictures or {}).items()}
    measures = measure_strokes(saved.strokes, saved.depth, saved.size) if len(saved.strokes) else None
    return page(
        "run.html.j2",
        name=name,
        lead=_lead(saved, metrics),
        interrupted=metrics.get("status") == "interrupted",
        figures=_figures(metrics),
        target=shown.pop("target", None),
        painting=shown.pop("painting", None),
        others=shown,
        renderer=saved.renderer,
        replay=None if measures is None else replay_of(saved, measures),
        error=_error(pixels.get("painting"), pixels.get("target")),
        curves=_curves(curves or {}, metrics),
        strokes=None if measures is None else _strokes(saved, measures),
        light=_light(saved) if measures is not None and "painting" in pixels else None,
        settings=_settings(recorded_config(saved.config), shlex.split(command or "")[2:]),
        command=command,
    )


def _lead(saved: Saved, metrics: Mapping[str, Any]) -> str:
    """One line below the title."""
    height, width = saved.size
    count = len(saved.strokes)
    words = f"{count:,} stroke{'s' * (count != 1)} on {width:,} × {height:,} pixels, renderer {saved.renderer}"
    return words + (f", painted on {metrics['device']}" if metrics.get("device") else "")


def _figures(metrics: Mapping[str, Any]) -> list[dict[str, str]]:
    found = []
    for key, name, unit, digits, title in METRICS_SHOWN:
        value = metrics.get(key)
        if key == "psnr" and value is None and metrics.get("l1") == 0:
            value = math.inf  # which JSON does not know
        if isinstance(value, int | float):
            found.append({"name": name, "value": readable_number(value, digits), "unit": unit, "title": title})
    return found


def _for_template(picture: Picture, pixels: np.ndarray) -> dict[str, Any]:
    return {"source": picture_uri(picture), "width": pixels.shape[1], "height": pixels.shape[0]}


def _is_picture(path: Path) -> bool:
    """Whether a picture is there; one that is damaged is left out with a word in the log."""
    if not path.is_file():
        return False
    try:
        with Image.open(path) as image:
            image.verify()
    except UNREADABLE as error:
        log.warning("%s is left out, for it cannot be read: %s", path, error)
        return False
    return True


def _pixels(picture: Picture) -> np.ndarray:
    if isinstance(picture, np.ndarray):
        return picture
    with Image.open(picture) as image:
        return np.asarray(image.convert("RGB"))


def _error(painting: np.ndarray | None, target: np.ndarray | None) -> dict[str, Any] | None:
    """The error map and its legend; None without two pictures of one size."""
    if painting is None or target is None or painting.shape != target.shape:
        return None
    found = error_map(painting, target)
    return {"picture": _for_template(found.pixels, found.pixels), "scale": MAGMA, **vars(found)}


def _curves(curves: Mapping[str, Sequence[float]], metrics: Mapping[str, Any]) -> list[Chart]:
    """PSNR against steps and seconds, and each loss against steps."""
    steps = curves.get("step", ())
    pairs = [pair for pair in metrics.get("anytime") or [] if len(pair) == 2 and None not in pair]
    times, psnr = [pair[0] for pair in pairs], [pair[1] for pair in pairs]
    charts = [
        line_chart("PSNR by steps", steps, curves.get("psnr", ()), "steps", "dB"),
        line_chart("PSNR by time", times, psnr, "seconds of optimisation", "dB"),
    ]
    for name, values in curves.items():
        if name.startswith("loss/"):
            charts.append(line_chart(f"Loss {name.removeprefix('loss/')}", steps, values, "steps"))
    return [chart for chart in charts if chart is not None]


def _strokes(saved: Saved, measures: StrokeTable) -> dict[str, Any]:
    """How long, wide, bent and turned the strokes are, and in which colours."""
    charts = [
        histogram_chart("Length", measures.length, "pixels"),
        histogram_chart("Width", measures.width, "pixels"),
        histogram_chart("Elongatedness", measures.elongatedness, "length / width"),
        histogram_chart("Curvature", np.degrees(measures.curvature), "degrees from end to end"),
        histogram_chart("Visible share", 100 * measures.visible, "% of a stroke's paint"),
        rose_chart("Direction", measures.orientation, measures.length),
    ]
    paint = measures.area * measures.visible * saved.strokes.opacity.numpy()
    hidden = float((measures.visible < 0.01).mean())
    lead = (
        f"Half of the {len(measures):,} strokes are longer than {np.median(measures.length):.1f} px and wider than "
        f"{np.median(measures.width):.1f} px; {100 * hidden:.1f} % are hidden by later ones."
        if len(measures) > 1
        else f"The only stroke is {measures.length[0]:.1f} px long and {measures.width[0]:.1f} px wide."
    )
    return {
        "lead": lead,
        "charts": [chart for chart in charts if chart is not None],
        "swatches": swatches_of(saved.strokes.color.numpy().astype(float), paint),
    }


def _light(saved: Saved) -> dict[str, Any] | None:
    try:
        return height_map(saved)
    except UserError as error:
        log.warning("the page shows no relief: %s", error)
        return None


def _settings(config: Mapping[str, Any], overrides: Sequence[str]) -> list[dict[str, Any]]:
    """Keys and values by their first word, and what was typed of them; those without a group come first."""
    typed = {word.lstrip("+~").partition("=")[0] for word in overrides}
    names = {plugin.target: plugin.name for plugin in plugins()}
    groups: dict[str, list[tuple[str, str, bool]]] = {"": []}
    for key, value in _flat(config, names):
        group = key.partition(".")[0]
        rows = groups.setdefault(group if isinstance(config.get(group), dict) else "", [])
        rows.append((key, value, key in typed))
    return [{"name": name or "task", "typed": name in typed, "rows": rows} for name, rows in groups.items() if rows]


def _flat(config: Mapping[str, Any], names: Mapping[str, str], above: str = "") -> list[tuple[str, str]]:
    """Dotted keys and their values as YAML would show them; a class is shown by its name as a plugin."""
    found = []
    for key, value in config.items():
        name = f"{above}{key}"
        if key == "_target_":
            plugin = names.get(str(value), str(value).rpartition(".")[2])
            if not above.endswith(f"{plugin}."):  # below loss, keys are the names
                found.append((above.removesuffix("."), plugin))
        elif isinstance(value, dict) and value:
            found += _flat(value, names, f"{name}.")
        else:
            shown = "null" if value is None else str(value).lower() if isinstance(value, bool) else str(value)
            found.append((name, shown))
    return found


def _float(text: str | None) -> float:
    try:
        return float(text or "nan")
    except ValueError:
        return math.nan
