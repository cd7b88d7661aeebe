"""Sheets show strokes with labels, as renderers draw them and as the engine painted them."""

from brushexp_studies.contact_sheet import SheetCell, draw_sheet
from PIL import Image
from torch import Tensor

from brushexp.contracts.families import Renderer
from brushexp.contracts.files import to_bytes
from brushexp_training.evaluation.benchmark import EXTREMES, ExtremeDrawings, draw_batch
from brushexp_training.evaluation.evaluation import over_white
from brushexp_training.stroke_sets.datamodule import StrokeBatch
from brushexp_training.stroke_sets.dataset import Origin

COLUMNS = 8  # strokes in a row
ZOOM = 2  # pixels on the sheets per pixel of a window


def sheet_of_strokes(renderers: dict[str, Renderer], batch: StrokeBatch, origin: Origin) -> Image.Image:
    """Draw a sheet of strokes, the true ones above those of each renderer."""
    kinds = {origin.engine: batch.images}
    for name, renderer in renderers.items():
        kinds[name] = draw_batch(renderer, batch, origin.window)[0]
    title = f"{', '.join(renderers)} on held-out strokes of {origin.engine}"
    return _sheet(kinds, [()] * len(batch.number), ZOOM * origin.window, title)


def sheet_of_extremes(name: str, engine: str, drawings: ExtremeDrawings) -> Image.Image:
    """Draw a sheet of strokes beyond the range of training, below the nearest ones in it."""
    kinds = {f"{engine}, nearest": drawings.nearest} | {f"{name}, {kind}": p for kind, p in drawings.pictures.items()}
    labels: list[tuple[str, ...]] = [(label,) for label in EXTREMES]
    side = ZOOM * drawings.nearest.shape[-1]
    return _sheet(kinds, labels, side, f"{name} outside the range of training")


def _sheet(kinds: dict[str, Tensor], labels: list[tuple[str, ...]], side: int, title: str) -> Image.Image:
    """Lay out pictures (n, 4, S, S) over white, a named row of each kind; labels stand below the last."""
    rows = []
    for k in range(0, len(labels), COLUMNS):
        here = slice(k, k + COLUMNS)
        for kind, images in kinds.items():
            pictures = [Image.fromarray(to_bytes(picture)) for picture in over_white(images[here].float().cpu())]
            below = labels[here] if kind == list(kinds)[-1] else [()] * len(pictures)
            rows.append([SheetCell(None, words=kind), *map(SheetCell, pictures, below)])
    return draw_sheet(rows, title, side)
