"""Write a painting's page, a single file that shows its pictures, strokes, curves and settings."""

import json
import math
import shlex
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, wait
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
from PIL import Image

from brushexp.pages import drawings
from brushexp.pages.html import embed, page, readable_number
from brushexp.pages.replay import replay_of
from brushexp.painting.finished import Finished
from brushexp.registry import family_of_key, name_of_target
from brushexp.results.anytime_curves import curve_from
from brushexp.results.quantities import quantities
from brushexp.results.runs import command_of, look_of, read_curves
from brushexp.results.stroke_table import SIZE_MEASURES, StrokeTable, measure_strokes, sizes_set_by
from brushexp.shading.light import overlay
from brushexp.strokes.saved import Saved, config_of
from brushexp.system.files import TEMPORARY, write_text
from brushexp.system.status import Status
from brushexp.system.words import table_of_words

PAGE_NAME = "report.html"
FILES = {  # files of a run in the order in which the page lists them
    "painting.png": "the painting",
    "flat.png": "the colours without the light",
    "strokes.svg": "the strokes, for Inkscape and the web",
    "catalogue.h5": "the strokes, for exports and further painting",
    "timelapse.mp4": "how the strokes moved",
    "timelapse.gif": "how the strokes moved",
    "target.png": "the picture that was painted",
    "metrics.json": "its numbers",
    "curves/metrics.csv": "the curves, as a table",
}
OTHERS = {  # pictures shown next to the painting
    "style": "the painting whose style was transferred",
    "focus": "the focus: the brighter, the more an error counts",
}
NOT_LISTED = (PAGE_NAME, "checkpoint.ckpt", "lock", "files.txt", TEMPORARY)  # files that the page does not list
NULL_COUNTS = ("working_resolution",)  # keys whose null differs from their default
LARGEST_SIDE = 1600  # pixels on the longer side of a picture in a page
LOSSLESS = 2**18  # pixels of the largest PNG; larger pictures become JPEGs
JPEG = {"format": "JPEG", "quality": 92, "subsampling": 0}
WEBP = {"format": "WEBP", "quality": 85, "alpha_quality": 100, "method": 0}  # encoding of the picture of the light
FIRST_NUMBERS = (  # shown before the metrics: key in metrics.json, name, unit, digits, meaning
    ("n_strokes", "strokes", "", 0, "in the catalogue"),
    ("steps", "steps", "", 0, "of gradient descent"),
    ("seconds", "optimisation", "s", 1, "wall time of the steps"),
    ("psnr_lit", "PSNR in the light", "dB", 2, "of the painting under its lamp, although the target has no lamp"),
)


def write_run_page(folder: Path, finished: Finished, film: Future[Any] | None = None) -> Path:
    """Wait for ``film`` to be written, write ``report.html`` to a run's folder, and return the page's path."""
    write_text(folder / PAGE_NAME, page_in(folder, finished, film))
    return folder / PAGE_NAME


def page_in(folder: Path, finished: Finished, film: Future[Any] | None = None) -> str:
    """Build a painting's page, including the curves, command and files from its run folder."""
    image = config_of(finished.job.saved).get("image")
    return run_page(
        finished,
        name=Path(str(image or folder.resolve().name)).name,
        look=look_of(folder),
        curves=read_curves(folder / "curves" / "metrics.csv"),
        command=command_of(folder) if finished.metrics else None,
        files=files_in(folder, film),
        beside=(folder / "painting.png").is_file(),
    )


def files_in(folder: Path, film: Future[Any] | None = None) -> Iterator[dict[str, str]]:
    """Yield the name, address relative to the page, and description of each file in a run folder.

    Skips the files in ``NOT_LISTED``, such as the page itself. Waits until ``film`` has been written before yielding
    the first file.
    """
    wait([] if film is None else [film])
    paths = sorted(path for path in folder.rglob("*") if path.is_file() and not any(map(path.match, NOT_LISTED)))
    names = [path.relative_to(folder).as_posix() for path in paths]
    for name in sorted(names, key=lambda name: list(FILES).index(name) if name in FILES else len(FILES)):
        yield {"name": name, "address": quote(name), "about": FILES.get(name, "")}


def run_page(
    finished: Finished,
    *,
    name: str,
    look: str = "",
    curves: Mapping[str, Sequence[float]] | None = None,
    command: str | None = None,
    files: Iterable[Mapping[str, str]] = (),
    beside: bool = False,
) -> str:
    """Build a painting's page as self-contained HTML; sections without data are omitted.

    ``name`` is the page's title, and ``look`` is the name of the painting's look. ``curves`` maps names (``step``,
    ``psnr``, ``loss/...``) to columns. ``files`` comes from `files_in`. ``beside`` says whether painting.png is in the
    same folder as the page.
    """
    job, metrics, pictures = finished.job, finished.metrics, finished.pictures
    saved, config = job.saved, config_of(job.saved)
    images = {key: embed_pixels(picture) for key, picture in pictures.items()}
    measures = measure_strokes(saved.strokes, saved.depth, saved.size) if len(saved.strokes) else None
    return page(
        "run.html.j2",
        name=name,
        lead=_lead(saved, look),
        interrupted=metrics.get("status") == Status.INTERRUPTED,
        figures=_figures(metrics),
        target=images.pop("target", None),
        painting=images.pop("painting", None),
        flat=images.pop("flat", None),
        overlay=_overlay(pictures),
        others=images,
        beside=beside,
        about=OTHERS,
        renderer=saved.renderer,
        replay=None if measures is None else replay_of(job, measures),
        error=_error(pictures.get("flat", pictures.get("painting")), pictures.get("target")),
        curves=_curves(curves or {}, metrics),
        strokes=None if measures is None else _strokes(saved, measures),
        sizes_by=sizes_set_by(saved),
        light=drawings.height_map(job) if measures is not None and "painting" in pictures else None,
        settings=list_settings(config, shlex.split(command or "")[1:]),
        line=line_of(config),
        command=command,
        files=files,
    )


def embed_pixels(pixels: np.ndarray) -> dict[str, Any]:
    """Embed a picture (H, W, 3) for the template, shrunk if it is large, and return it with its original size."""
    height, width, _ = pixels.shape
    options: dict[str, Any] = {} if height * width <= LOSSLESS else JPEG
    return embed(Image.fromarray(pixels), LARGEST_SIDE, **options) | {"width": width, "height": height}


def _lead(saved: Saved, look: str) -> str:
    """Describe a painting's medium, strokes and size in words."""
    (height, width), count = saved.size, len(saved.strokes)
    medium = table_of_words("look_in_words").get(look, "")
    brush = table_of_words("renderer_in_words").get(saved.renderer, f"drawn by renderer={saved.renderer}")
    strokes = " ".join([f"{count:,} stroke{'s' * (count != 1)}", *[brush] * bool(brush)])
    words = ", ".join([*[medium] * bool(medium), strokes, f"{width:,} × {height:,} pixels"])
    return words[0].upper() + words[1:]


def _figures(metrics: Mapping[str, Any]) -> list[dict[str, str]]:
    if metrics.get("psnr") is None and metrics.get("l1") == 0:
        metrics = {**metrics, "psnr": math.inf}  # JSON has no infinity
    measured = [(key, one.title, one.unit, one.digits, one.about) for key, one in quantities().items() if one.about]
    return [
        {"name": name, "value": readable_number(metrics[key], digits), "unit": unit, "title": title}
        for key, name, unit, digits, title in (*FIRST_NUMBERS, *measured)
        if isinstance(metrics.get(key), int | float)
    ]


def _error(painting: np.ndarray | None, target: np.ndarray | None) -> dict[str, Any] | None:
    """Compute the error map and its legend; return None if a picture is missing or the sizes differ."""
    if painting is None or target is None or painting.shape != target.shape:
        return None
    error = drawings.error_map(painting, target)
    return error | {"picture": embed_pixels(error["pixels"])}


def _curves(curves: Mapping[str, Sequence[float]], metrics: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return charts of PSNR against steps, seconds and strokes, and of each loss against steps.

    PSNR is plotted against strokes only if a density policy chose the number of strokes. That curve shows what the PSNR
    would be right after the least important strokes were removed, before the others adapt, and right after a hundred
    strokes were added, before further steps improve them.
    """
    steps = curves.get("step", ())
    times, psnr = curve_from(metrics.get("anytime")) or ((), ())
    charts = [
        drawings.line_chart("PSNR by steps", steps, curves.get("psnr", [math.nan] * len(steps)), "steps", "dB"),
        drawings.line_chart("PSNR by time", times, psnr, "seconds of optimisation", "dB"),
    ]
    if pairs := metrics.get("strokes_psnr"):
        counts, decibels = zip(*pairs, strict=True)
        by_strokes = drawings.line_chart("PSNR by strokes", counts, decibels, "strokes", "dB")
        charts.append(by_strokes and by_strokes | {"note": metrics.get("verdict", "")})
    losses = {name.removeprefix("loss/"): loss for name, loss in curves.items() if name.startswith("loss/")}
    charts += [drawings.line_chart(f"Loss {name}", steps, loss, "steps") for name, loss in losses.items()]
    return [chart for chart in charts if chart]


def _strokes(saved: Saved, measures: StrokeTable) -> dict[str, Any]:
    """Summarise the strokes with a sentence, charts of their measures, and swatches of their colours."""
    histograms = [
        ("Length", measures.length, "pixels"),
        ("Width", measures.width, "pixels"),
        ("Elongatedness", measures.elongatedness, "length / width"),
        ("Curvature", np.degrees(measures.curvature), "degrees from end to end"),
        ("Visible share", 100 * measures.visible, "% of a stroke's paint"),
    ]
    charts = [drawings.histogram_chart(*histogram) for histogram in histograms]
    if setter := sizes_set_by(saved):
        for chart in charts:
            if chart and chart["title"].lower() in SIZE_MEASURES:
                chart["note"] = f"Set by {setter}, so it says nothing about the brushwork of the picture."
    charts.append(drawings.rose_chart("Direction", measures.orientation, measures.length))
    paint = measures.area * measures.visible * saved.strokes.opacity.numpy()
    hidden = float((measures.visible < 0.01).mean())
    lead = (
        f"Half of the {len(measures):,} strokes are longer than {np.median(measures.length):.1f} px and wider than "
        f"{np.median(measures.width):.1f} px; {100 * hidden:.1f} % of all strokes are hidden by later ones."
        if len(measures) > 1
        else f"The only stroke is {measures.length[0]:.1f} px long and {measures.width[0]:.1f} px wide."
    )
    swatches = drawings.swatches_of(saved.strokes.color.numpy().astype(float), paint)
    return {"lead": lead, "charts": [chart for chart in charts if chart], "swatches": swatches}


def _overlay(pictures: Mapping[str, np.ndarray]) -> str | None:
    """Encode a painting's light as an overlay for its flat colours; return None if the painting is unlit."""
    if "flat" not in pictures or "painting" not in pictures:
        return None
    light = Image.fromarray(overlay(pictures["flat"], pictures["painting"]))
    return str(embed(light, LARGEST_SIDE, **WEBP)["source"])


def list_settings(config: Mapping[str, Any], overrides: Sequence[str]) -> list[tuple[str, str, bool]]:
    """List each setting's dotted key, its value as a user would type it, and whether the user set it."""
    typed = {word.lstrip("+~").partition("=")[0] for word in overrides}
    rows = ((key.removesuffix("._target_"), _as_name(key, value)) for key, value in _flat(config))
    return [(key, value, key in typed) for key, value in rows]


def _as_name(key: str, value: str) -> str:
    """Return a setting's value, or a plugin's name if the setting is a plugin."""
    return name_of_target(value, family_of_key(key)) if key.endswith("._target_") else value


def line_of(config: Mapping[str, Any]) -> str:
    """Return all settings as one command line: plugins by name, then every key that has a value."""
    chosen = {key.removesuffix("._target_") for key, _ in _flat(config) if key.endswith("._target_")}
    words, keys = [], []
    for key, value in config.items():
        if isinstance(value, dict) and "_target_" in value:
            words.append(f"{key}={name_of_target(str(value['_target_']), key)}")
        elif isinstance(value, dict) and value and all(isinstance(one, dict) for one in value.values()):
            words.append(f"{key}=[{','.join(value)}]")
    for key, text in _flat(config):
        if (
            key.endswith("_target_")
            or text == "{}"
            or (text == "null" and key not in NULL_COUNTS)
            or key in ("task", "output", "overwrite", "resume")
        ):
            continue
        below = key.rpartition(".")[0].rpartition(".")[0]  # an option that is a mapping has keys chosen by the user
        keys.append(f"{'++' * (below in chosen)}{key}={text}")
    return shlex.join(["brushexp", "look=even", *words, *keys])


def _flat(config: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, str]]:
    for key, value in config.items():
        if isinstance(value, dict) and value:
            yield from _flat(value, f"{above}{key}.")
        else:
            yield f"{above}{key}", value if isinstance(value, str) else json.dumps(value, default=str)
