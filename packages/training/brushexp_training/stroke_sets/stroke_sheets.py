"""Draw labelled sheets that compare renderers' strokes with the engine's strokes."""

from brushexp_studies.contact_sheet import SheetCell, draw_sheet
from PIL import Image
from torch import Tensor

from brushexp.contracts.families import Renderer
from brushexp.contracts.files import to_bytes
from brushexp_training.evaluation.benchmark import EXTREMES, ExtremeDrawings, draw_batch
from brushexp_training.evaluation.evaluation import over_white
from brushexp_training.stroke_sets.datamodule import StrokeBatch
from brushexp_training.stroke_sets.dataset import Origin

COLUMNS = 8  # strokes per row
ZOOM = 2  # pixels of a sheet per pixel of a window


def sheet_of_strokes(renderers: dict[str, Renderer], batch: StrokeBatch, origin: Origin) -> Image.Image:
    """Draw a sheet with the true strokes above the same strokes as drawn by each renderer."""
    kinds = {origin.engine: batch.images}
    for name, renderer in renderers.items():
        kinds[name] = draw_batch(renderer, batch, origin.window)[0]
    title = f"{', '.join(renderers)} on held-out strokes of {origin.engine}"
    return _sheet(kinds, [()] * len(batch.number), ZOOM * origin.window, title)


def sheet_of_extremes(name: str, engine: str, drawings: ExtremeDrawings) -> Image.Image:
    """Draw a sheet of strokes outside the training range, below the engine's pictures of the nearest strokes inside."""
    kinds = {f"{engine}, nearest": drawings.nearest} | {f"{name}, {kind}": p for kind, p in drawings.pictures.items()}
    labels: list[tuple[str, ...]] = [(label,) for label in EXTREMES]
    side = ZOOM * drawings.nearest.shape[-1]
    return _sheet(kinds, labels, side, f"{name} outside the training range")


def _sheet(kinds: dict[str, Tensor], labels: list[tuple[str, ...]], side: int, title: str) -> Image.Image:
    """Arrange pictures (n, 4, S, S) over white, with a labelled row for each kind and labels below the last row."""
    rows = []
    for k in range(0, len(labels), COLUMNS):
        here = slice(k, k + COLUMNS)
        for kind, images in kinds.items():
            pictures = [Image.fromarray(to_bytes(picture)) for picture in over_white(images[here].float().cpu())]
            below = labels[here] if kind == list(kinds)[-1] else [()] * len(pictures)
            rows.append([SheetCell(None, words=kind), *map(SheetCell, pictures, below)])
    return draw_sheet(rows, title, side)
