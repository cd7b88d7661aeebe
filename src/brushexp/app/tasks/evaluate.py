"""``task=evaluate``: judge a renderer on strokes that it was not trained on."""

from __future__ import annotations

import csv
import io
import logging
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import lightning as L
import torch
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig
from PIL import Image
from rich.console import Console
from rich.progress import track
from torch import Tensor

from brushexp.errors import UserError
from brushexp.plugins.blend.base import Blend
from brushexp.plugins.engine.base import Engine
from brushexp.plugins.renderer.base import Renderer
from brushexp.plugins.renderer.weights_file import checkpoint_path, read_recipe
from brushexp.registry import build, build_named, plugin_of
from brushexp.results.contact_sheet import SheetCell, draw_sheet
from brushexp.system.checkpoint import weights_hash
from brushexp.system.device import device_of
from brushexp.system.files import to_bytes, write_bytes, write_json, write_text
from brushexp.system.process import peak_memory
from brushexp.training.benchmark import EXTREMES, Outside, draw_extremes, drawn_and_true, judge, strokes_per_second
from brushexp.training.datamodule import EngineSource, StrokeBatch, StrokeData
from brushexp.training.dataset import Origin, Split, origin_of, require_same_origin
from brushexp.training.evaluation import FeatureDistance, effl0_distance, inception_distance, over_white

SIMULATED = 1000  # strokes, if no number is asked for
SHOWN, COLUMNS = 24, 8  # strokes in the picture, and in a row of it
EXTREME_COLUMNS = 8
ZOOM = 2  # pixels on the sheets per pixel of a window

log = logging.getLogger(__name__)


def run(cfg: DictConfig, start: float) -> dict[str, object]:
    """Write numbers and pictures of one renderer into the run's folder, and return the numbers."""
    folder = Path(HydraConfig.get().runtime.output_dir)
    split_of(cfg.split)
    L.seed_everything(cfg.seed, verbose=False)
    device = device_of(cfg.device)
    name, checkpoint = plugin_of(cfg.renderer).name, cfg.renderer.get("checkpoint")
    renderer = frozen(build(cfg.renderer), device)
    data, engine = held_out_data(cfg)
    window = data.origin.window
    check_origin(cfg, data.origin)
    if checkpoint is None and any(True for _ in renderer.parameters()):
        log.warning("%s has random weights; give those of task=train: renderer.checkpoint=...", name)
    before = time.monotonic()
    costs = {"threads": torch.get_num_threads(), **cost(renderer, build(cfg.blend), window)}
    n = number_of(data, cfg.split, cfg.n)
    batches = shown(held_out(data, cfg.split, n), n, data.batch_size)
    figures = judge(renderer, batches, window, crowds(cfg.inception, n, device))
    examples = first_strokes(held_out(data, cfg.split, n), SHOWN)
    write_sheet(folder / "strokes.png", sheet_of_strokes({name: renderer}, examples, data.origin))
    outside = draw_extremes(renderer, engine)
    write_sheet(folder / "outside.png", sheet_of_extremes(name, data.origin.engine, outside))
    write_text(folder / "outside.csv", as_csv(outside.rows))
    metrics: dict[str, object] = {
        **figures,
        **costs,
        "file_mb": None if checkpoint is None else checkpoint_path(checkpoint).stat().st_size / 1e6,
        "n": n,
        "finite_outside": outside.finite,
        "renderer": name,
        "renderer_hash": weights_hash(renderer),
        "checkpoint": checkpoint,
        "data": "simulated" if cfg.data is None else ", ".join(cfg.data),
        "engine": data.origin.engine,
        "split": cfg.split,
        "device": str(device),
        "seconds": time.monotonic() - before,
        "seconds_total": time.monotonic() - start,
        "peak_memory_mb": peak_memory(),
        "picture": "strokes.png",
        "status": "completed",
    }
    write_json(folder / "metrics.json", metrics)
    log.info("%s: %s; %s", name, summary(metrics), folder / "strokes.png")
    return metrics


def summary(metrics: dict[str, Any]) -> str:
    """The main numbers on one line."""
    return (
        f"L2 {metrics['l2']:.6f}, alpha {metrics['psnr_alpha']:.2f} dB, "
        f"FID (effl0, {metrics['n']} strokes) {metrics['fid_effl0']:.2f}, "
        f"{metrics['strokes_per_second']:.0f} strokes/s forward, "
        f"{metrics['strokes_per_second_backward']:.0f} with gradient"
    )


def frozen(renderer: Renderer, device: torch.device) -> Renderer:
    """The renderer as painting uses it."""
    return renderer.to(device).eval().requires_grad_(False)


def cost(renderer: Renderer, blend: Blend, window: int) -> dict[str, float]:
    """Speed (strokes/s, see `strokes_per_second`) and numbers."""
    return {
        "strokes_per_second": strokes_per_second(renderer, blend, window, backward=False),
        "strokes_per_second_backward": strokes_per_second(renderer, blend, window, backward=True),
        "parameters": sum(parameter.numel() for parameter in renderer.parameters()),
    }


def held_out_data(cfg: DictConfig) -> tuple[StrokeData, Engine]:
    """The strokes, and the engine that made them."""
    if cfg.data is None:
        engine: Engine = build(cfg.engine)
        source = EngineSource(engine, origin_of(cfg.engine, engine), seed=cfg.seed, held_out=cfg.n or SIMULATED)
        return StrokeData(source), engine
    data = StrokeData([Path(path) for path in cfg.data])
    return data, build_named("engine", data.origin.engine, data.origin.engine_config)


def check_origin(cfg: DictConfig, found: Origin) -> None:
    """Stop if a trained renderer knows another brush than that of the strokes, unless that is wanted.

    Raises:
        UserError: says what differs, and how to judge it all the same.
    """
    checkpoint = cfg.renderer.get("checkpoint")
    recipe = {} if checkpoint is None else read_recipe(checkpoint_path(checkpoint)).get("data", {})
    if cfg.other_data or not isinstance(recipe, dict) or not {"engine", "engine_config", "window"} <= recipe.keys():
        return
    trained = Origin(recipe["engine"], recipe["engine_config"], recipe["window"])
    name = f"engine={found.engine}" if cfg.data is None else cfg.data[0]
    try:
        require_same_origin(trained, found, name)
    except UserError as error:
        raise UserError(f"{error}; other_data=true judges it all the same") from error


def held_out(data: StrokeData, split: str, n: int) -> Iterator[StrokeBatch]:
    """The first n strokes of a split."""
    loader = data.test_dataloader() if split_of(split) is Split.TEST else data.val_dataloader()
    for batch in loader:
        if n <= 0:
            break
        yield StrokeBatch(*(values[:n] for values in batch))
        n -= len(batch.number)


def number_of(data: StrokeData, split: str, wanted: int | None) -> int:
    """Strokes that are judged: as many as wanted, and there."""
    if isinstance(data.source, EngineSource):
        there = data.source.held_out
    else:
        there = sum(len(split_of(split).numbers(len(strokes))) for strokes in data.sets)
    return min(there, wanted or there)


def split_of(name: str) -> Split:
    """The split of this name, unless it is the one for training."""
    names = {split.name.lower(): split for split in (Split.TEST, Split.VALIDATION)}
    if name not in names:
        raise UserError(f"split={name} is not one of {', '.join(names)}; try split=test")
    return names[name]


def crowds(inception: str | None, n: int, device: torch.device) -> list[FeatureDistance]:
    """What compares all pictures together."""
    distances = [effl0_distance(n, device)]
    return distances if inception is None else [*distances, inception_distance(Path(inception), n, device)]


def shown(batches: Iterator[StrokeBatch], n: int, batch_size: int) -> Iterator[StrokeBatch]:
    """The same, with a bar where there is a terminal."""
    console = Console(stderr=True)
    total = -(-n // batch_size)
    yield from track(batches, "judging", total, console=console, transient=True, disable=not console.is_terminal)


def sheet_of_strokes(renderers: dict[str, Renderer], batch: StrokeBatch, origin: Origin) -> Image.Image:
    """Some strokes, the true ones above those that each of the renderers draws."""
    kinds = {origin.engine: batch.images}
    for name, renderer in renderers.items():
        kinds[name] = drawn_and_true(renderer, batch, origin.window)[0]
    pictures = {name: pictures_of(images) for name, images in kinds.items()}
    rows, heads = [], []
    for k in range(0, len(batch.number), COLUMNS):
        for name, drawn in pictures.items():
            rows.append([SheetCell(picture) for picture in drawn[k : k + COLUMNS]])
            heads.append(name)
    title = f"{', '.join(renderers)} on held-out strokes of {origin.engine}"
    return draw_sheet(rows, title, heads, side=ZOOM * origin.window)


def first_strokes(batches: Iterable[StrokeBatch], n: int) -> StrokeBatch:
    """The first n of them in one batch."""
    kept: list[StrokeBatch] = []
    for batch in batches:
        kept.append(batch)
        if sum(len(part.number) for part in kept) >= n:
            break
    return StrokeBatch(*(torch.cat(values)[:n] for values in zip(*kept, strict=True)))


def sheet_of_extremes(name: str, engine: str, outside: Outside) -> Image.Image:
    """The strokes at and beyond the edge of the range: the nearest ones in it, painted, and drawn as they are."""
    kinds = {f"{engine}, nearest": outside.nearest} | {f"{name}, {kind}": p for kind, p in outside.pictures.items()}
    labels = [(label,) for label in EXTREMES]
    rows, heads = [], []
    for k in range(0, len(labels), EXTREME_COLUMNS):
        for kind, images in kinds.items():
            here = slice(k, k + EXTREME_COLUMNS)
            last = kind == list(kinds)[-1]
            pairs = zip(pictures_of(images[here]), labels[here], strict=True)
            rows.append([SheetCell(picture, label if last else ()) for picture, label in pairs])
            heads.append(kind)
    side = ZOOM * outside.nearest.shape[-1]
    return draw_sheet(rows, f"{name} outside the range of training", heads, side=side)


def pictures_of(images: Tensor) -> list[Image.Image]:
    """Over white, each by itself."""
    return [Image.fromarray(to_bytes(picture)) for picture in over_white(images.float().cpu())]


def write_sheet(path: Path, sheet: Image.Image) -> None:
    """Write a PNG."""
    encoded = io.BytesIO()
    sheet.save(encoded, format="PNG")
    write_bytes(path, encoded.getvalue())


def as_csv(rows: Sequence[Mapping[str, object]]) -> str:
    """A table with the keys of the first row as its columns."""
    file = io.StringIO()
    writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return file.getvalue()
