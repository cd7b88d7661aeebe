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

from brushexp.analysis.measures import Measures, measures_of
from brushexp.errors import UserError
from brushexp.registry import plugins
from brushexp.results.drawing import UNREADABLE
from brushexp.results.page.error import MAGMA, error_map
from brushexp.results.page.html import number, page, picture_uri
from brushexp.results.page.palette import palette
from brushexp.results.page.plots import Plot, Tick, histogram, line_plot, rose
from brushexp.results.page.relief import relief_of
from brushexp.results.page.replay import replay_of, settings_of
from brushexp.results.runs import command_of
from brushexp.results.table import read_result
from brushexp.strokes.storage import Saved, load_catalogue
from brushexp.system.files import write_text

log = logging.getLogger(__name__)
NAME = "report.html"
OTHERS = {"style.png": "style", "focus.png": "focus"}  # files of a run that some have
Pixels = np.ndarray | Path  # (H, W, 3) uint8, or a file
FIGURES = (  # of metrics.json: key, name, unit, digits, what it is
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
    write_text(folder / NAME, page_of_run(folder))
    return folder / NAME


def page_of_run(folder: Path) -> str:
    """The page of a run, from what it has left in its folder; writes nothing.

    Raises:
        UserError: if there is no catalogue, or it is damaged.
    """
    saved = load_catalogue(folder / "catalogue.h5")
    metrics = read_result(folder / "metrics.json") if (folder / "metrics.json").is_file() else None
    files = {name: folder / name for name in ("target.png", "painting.png", *OTHERS) if _is_picture(folder / name)}
    image = settings_of(saved).get("image")
    command = None if metrics is None else command_of(folder, metrics)
    return run_page(
        saved,
        name=Path(str(image or folder.resolve().name)).name,
        target=files.get("target.png"),
        painting=files.get("painting.png"),
        others={OTHERS[name]: path for name, path in files.items() if name in OTHERS},
        metrics=metrics,
        curves=read_curves(folder / "curves" / "metrics.csv"),
        overrides=shlex.split(command or "")[2:],
        command=command,
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
    target: Pixels | None = None,
    painting: Pixels | None = None,
    others: Mapping[str, Pixels] | None = None,
    metrics: Mapping[str, Any] | None = None,
    curves: Mapping[str, Sequence[float]] | None = None,
    overrides: Sequence[str] = (),
    command: str | None = None,
) -> str:
    """The page of a painting; a part of which nothing is known is left out.

    Args:
        saved: its catalogue.
        name: of the picture, a title.
        target: what was painted.
        painting: the result; without one there are no error map and no light.
        others: more pictures, by name.
        metrics: as in metrics.json.
        curves: columns by name: ``step``, ``seconds``, ``psnr``, ``loss/...``.
        overrides: what was typed, ``key=value`` each.
        command: what repeats the run.

    Returns:
        HTML that needs nothing else.
    """
    count = len(saved.strokes)
    measures = measures_of(saved.strokes, saved.depth, saved.size) if count else None
    metrics = metrics or {}
    pictures = {key: _pixels(value) for key, value in (("target", target), ("painting", painting)) if value is not None}
    return page(
        "run.html.j2",
        name=name,
        lead=_lead(saved, metrics),
        note=_note(metrics),
        figures=_figures(metrics),
        target=None if target is None else _picture(target, pictures["target"]),
        painting=None if painting is None else _picture(painting, pictures["painting"]),
        others=[{"name": key, **_picture(value, _pixels(value))} for key, value in (others or {}).items()],
        renderer=saved.renderer,
        replay=None if measures is None else replay_of(saved, measures),
        error=_error(pictures),
        curves=_curves(curves or {}, metrics),
        strokes=None if measures is None else _strokes(saved, measures),
        light=_light(saved) if count and painting is not None else None,
        settings=_settings(settings_of(saved), overrides),
        command=command,
    )


def _lead(saved: Saved, metrics: Mapping[str, Any]) -> str:
    """One line below the title."""
    height, width = saved.size
    parts = [f"{_strokes_in_words(len(saved.strokes))} on {width:,} × {height:,} pixels", f"renderer {saved.renderer}"]
    device = metrics.get("device")
    return ", ".join([*parts, f"painted on {device}"] if device else parts)


def _strokes_in_words(count: int) -> str:
    return f"{count:,} stroke" + "s" * (count != 1)


def _note(metrics: Mapping[str, Any]) -> str:
    """What a reader should know before anything else."""
    status = metrics.get("status", "completed")
    return f"This run was {status}; it can be continued." if status == "interrupted" else ""


def _figures(metrics: Mapping[str, Any]) -> list[dict[str, str]]:
    found = []
    for key, name, unit, digits, title in FIGURES:
        value = metrics.get(key)
        if key == "psnr" and value is None and metrics.get("l1") == 0:
            value = math.inf  # which JSON does not know
        if isinstance(value, int | float):
            found.append({"name": name, "value": number(value, digits), "unit": unit, "title": title})
    return found


def _picture(source: Pixels, pixels: np.ndarray) -> dict[str, Any]:
    """A picture for a template."""
    height, width = pixels.shape[:2]
    return {"source": picture_uri(source), "width": width, "height": height}


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


def _pixels(source: Pixels) -> np.ndarray:
    if isinstance(source, np.ndarray):
        return source
    with Image.open(source) as image:
        return np.asarray(image.convert("RGB"))


def _error(pictures: Mapping[str, np.ndarray]) -> dict[str, Any] | None:
    if len(pictures) < 2 or pictures["target"].shape != pictures["painting"].shape:
        return None
    found = error_map(pictures["painting"], pictures["target"])
    shares = (0, 0.25, 0.5, 0.75, 1)
    ticks = [
        Tick(10 + 300 * share, f"{share * found.top:.0f}" + "+" * (share == 1 and found.above > 0)) for share in shares
    ]
    picture = _picture(found.pixels, found.pixels)
    return {"picture": picture, "scale": MAGMA, "ticks": ticks, **vars(found)}


def _curves(curves: Mapping[str, Sequence[float]], metrics: Mapping[str, Any]) -> list[Plot]:
    """PSNR against steps and seconds, and each loss against steps."""
    steps = curves.get("step", ())
    pairs = [pair for pair in metrics.get("anytime") or [] if len(pair) == 2 and None not in pair]
    times, best = [pair[0] for pair in pairs], [pair[1] for pair in pairs]
    plots = [
        line_plot("PSNR by steps", steps, curves.get("psnr", ()), "steps", "dB"),
        line_plot("PSNR by time", times, best, "seconds of optimisation", "dB"),
    ]
    for name, values in curves.items():
        if name.startswith("loss/"):
            plots.append(line_plot(f"Loss {name.removeprefix('loss/')}", steps, values, "steps"))
    return [plot for plot in plots if plot is not None]


def _strokes(saved: Saved, measures: Measures) -> dict[str, Any]:
    """How long, wide, bent and turned the strokes are, and in which colours."""
    bend = np.degrees(measures.curvature)
    found = [
        histogram("Length", measures.length, "pixels"),
        histogram("Width", measures.width, "pixels"),
        histogram("Elongatedness", measures.elongatedness, "length / width"),
        histogram("Curvature", bend, "degrees from end to end"),
        histogram("Visible share", 100 * measures.visible, "% of a stroke's paint"),
    ]
    weights = measures.area * measures.visible * saved.strokes.opacity.numpy()
    hidden = float((measures.visible < 0.01).mean())
    lead = (
        f"Half of the {len(measures):,} strokes are longer than {np.median(measures.length):.1f} px and wider than "
        f"{np.median(measures.width):.1f} px; {number(100 * hidden, 1)} % are hidden by later ones."
        if len(measures) > 1
        else f"The only stroke is {measures.length[0]:.1f} px long and {measures.width[0]:.1f} px wide."
    )
    return {
        "lead": lead,
        "plots": [plot for plot in found if plot is not None],
        "rose": rose(measures.orientation, measures.length),
        "palette": palette(saved.strokes.color.numpy().astype(float), weights),
    }


def _light(saved: Saved) -> dict[str, Any] | None:
    try:
        return relief_of(saved)
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
        several = isinstance(config.get(group), dict)
        groups.setdefault(group if several else "", []).append((key, value, key in typed))
    shown = {name: rows for name, rows in groups.items() if rows}
    return [{"name": name or "task", "typed": name in typed, "rows": rows} for name, rows in shown.items()]


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
