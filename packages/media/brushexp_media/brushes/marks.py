"""Read brush marks (pictures of one stroke, from left to right) from files, and convert them to textures."""

import logging
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from brushexp.contracts import UserError
from brushexp.contracts.layers import SPREAD, TEXEL_ASPECT, Loop
from brushexp.contracts.members import close_loop
from brushexp.contracts.pictures import BRIGHTNESS, load_cutout, nearest_files, picture_suffixes
from brushexp_media.brushes.archives import SHAPES, brushes_in
from brushexp_media.brushes.gimp import Stamp, read_stamps
from brushexp_media.brushes.photoshop import SPACING, read_abr

log = logging.getLogger(__name__)

PIPES = (".gbr", ".gih")  # GIMP's files, whose stamps take turns
SETS = (".abr",)  # Photoshop's files, in which each stamp is a brush
BRUSHES = (*PIPES, *SETS, *SHAPES)
ELSEWHERE = {  # files of other programs, and how to convert them
    ".kpp": "a preset of Krita, whose brush is another file; give that one, a .gbr, .gih or PNG, or a .bundle",
    ".myb": "a brush of MyPaint, a recipe without a picture; paint a stroke with it and save that as PNG",
    ".vbr": "a brush of GIMP that is a formula; paint a stroke with it and save that as PNG",
}
MOST_MARKS = 64  # maximum number of marks of a renderer
LARGEST_SIDE = 2048  # longer side in pixels at which a picture is read
PAPER = 0.1  # share of the contrast below which a scan shows only the grain of its paper
DARKEST = 0.95  # share of a scanned mark that is at most as dark as full coverage
ALONG = 8  # length over which a stamp is dragged, in stamp heights
STAMP = 96  # longer side, in pixels, of a stamp that is dragged
ROWS = 128  # texels across a texture
LENGTHS = (128, 256, 512)  # texels along: 6, 12 or 24 half widths
OVER = 0.5  # half widths by which a mark extends beyond both ends of the curve
FULL = 0.3  # coverage, relative to the fullest row, above which a row belongs to the width of a mark


@dataclass(frozen=True, eq=False)
class Mark:
    """A picture of one stroke, painted from left to right."""

    name: str  # file name, numbered if the file has several marks
    coverage: np.ndarray  # (H, W) float32 in [0, 1]


def read_marks(paths: Sequence[str]) -> list[Mark]:
    """Read the marks in files and folders; raise a UserError that names the key and the problem."""
    files = [file for path in paths for file in _files_of(path)]
    marks = [mark for file in files for mark in _marks_of(file)]
    if len(marks) > MOST_MARKS:
        raise UserError(f"brush={','.join(paths)} has {len(marks)} marks; give at most {MOST_MARKS}, file by file")
    return marks


def _files_of(path: str) -> list[str]:
    """List the mark files in a folder, sorted by name; if the path is a file, list only that."""
    path = os.path.expanduser(path)
    if not os.path.exists(path):
        near = [f"did you mean {name}? " for name in nearest_files(path)[:1]]
        raise UserError(
            f"brush={path} is not there; {''.join(near)}give a picture of a stroke, a .gbr or .gih of GIMP, or an .abr"
        )
    if not os.path.isdir(path):
        return [path]
    files = [str(file) for file in sorted(Path(path).iterdir()) if _suffix_of(file) in {*BRUSHES, *picture_suffixes()}]
    if not files:
        raise UserError(f"brush={path} has no brush in it; put strokes as PNG there, .gbr and .gih of GIMP, or .abr")
    return files


def _suffix_of(path: str | Path) -> str:
    return Path(path).suffix.lower()


def _marks_of(file: str) -> list[Mark]:
    """Read the marks in a file; if a set has more than ``MOST_MARKS`` brushes, log a warning and omit the rest."""
    name, ending = Path(file).name, _suffix_of(file)
    if (kind := ELSEWHERE.get(ending)) is not None:
        raise UserError(f"brush={file} is {kind}")
    try:
        if ending not in BRUSHES:
            return [_mark_of_picture(name, file)]
        try:
            data = Path(file).read_bytes()
        except OSError as error:
            raise UserError(f"cannot be read ({error.strerror}); give the path of a brush") from error
        marks = [*islice(_marks_in(name, ending, data), MOST_MARKS + 1)]
    except UserError as error:
        raise UserError(str(error) if str(error).startswith("brush=") else f"brush={file} {error}") from error
    if len(marks) > MOST_MARKS and ending not in PIPES:
        log.warning("%s has more than %d brushes; the first %d are used", name, MOST_MARKS, MOST_MARKS)
        return marks[:MOST_MARKS]
    return marks


def _mark_of_picture(name: str, file: str) -> Mark:
    color, alpha = load_cutout(file, None, "brush")
    return Mark(name, turn_lengthwise(crop_mark(shrink_mark(coverage_of(color, alpha)))))


def _marks_in(name: str, ending: str, data: bytes) -> Iterator[Mark]:
    """Yield the marks in a file of stamps, or in an archive of such files."""
    if ending in SHAPES:
        for inner, content in brushes_in(data, ending):
            yield from _marks_in(f"{name}: {inner}", _suffix_of(inner), content)
        return
    if ending in PIPES:
        stamps = read_stamps(data)
        turns = [stamps[k:] + stamps[:k] for k in range(len(stamps))]
    elif ending in SETS:
        turns = [[stamp] for stamp in read_abr(data)]
    else:
        turns = [[Stamp(_coverage_of_bytes(data), SPACING)]]
    for k, turn in enumerate(turns):
        yield Mark(name + f" {k + 1}" * (len(turns) > 1), crop_mark(drag_stamps(turn)))


def _coverage_of_bytes(data: bytes) -> np.ndarray:
    """Compute the coverage (H, W) of a picture extracted from an archive."""
    with TemporaryDirectory() as folder:
        path = Path(folder, "brush.png")
        path.write_bytes(data)
        color, alpha = load_cutout(str(path), None, "brush")
    return crop_mark(shrink_mark(coverage_of(color, alpha)))


def coverage_of(color: Tensor, alpha: Tensor) -> np.ndarray:
    """Compute the coverage (H, W) of a picture (3, H, W): its alpha, or its difference from the grey of its border."""
    if float(alpha.min()) < 1 - PAPER:
        return alpha.numpy()
    grey = torch.einsum("chw,c->hw", color, torch.tensor(BRIGHTNESS)).numpy()
    ground = np.median(np.concatenate([grey[0], grey[-1], grey[:, 0], grey[:, -1]]))
    far = np.abs(grey - ground)
    if ground in (0.0, 1.0):
        return far
    full = np.quantile(far[far >= 0.5 * far.max()], DARKEST)
    return ((far / max(full, 1e-6) - PAPER) / (1 - PAPER)).clip(0, 1)


def shrink_mark(coverage: np.ndarray, side: int = LARGEST_SIDE) -> np.ndarray:
    """Downsample a mark to at most ``side`` pixels per side by averaging."""
    shape = np.array(coverage.shape)
    size = tuple(int(one) for one in np.maximum(np.round(shape * min(side / shape.max(), 1)), 1))
    return functional.interpolate(
        torch.from_numpy(np.ascontiguousarray(coverage, np.float32))[None, None], size, mode="bilinear", antialias=True
    )[0, 0].numpy()


def crop_mark(coverage: np.ndarray) -> np.ndarray:
    """Crop a mark to its bounding box; raise a UserError if the mark is empty."""
    rows, columns = (np.flatnonzero((coverage > PAPER).any(axis)) for axis in (1, 0))
    if not len(rows):
        raise UserError("has no mark on it; give a stroke in another brightness than its ground, or transparent around")
    return coverage[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]


def turn_lengthwise(coverage: np.ndarray) -> np.ndarray:
    """Rotate a mark anticlockwise if it is taller than wide, so that a downward stroke points to the right."""
    height, width = coverage.shape
    return np.ascontiguousarray(np.rot90(coverage)) if height > width else coverage


def drag_stamps(stamps: Sequence[Stamp]) -> np.ndarray:
    """Drag stamps along a line, using them in turn; as in GIMP, each dab is composited over the previous ones."""
    side = max(max(stamp.coverage.shape) for stamp in stamps)
    dabs = [
        shrink_mark(stamp.coverage, max(1, round(STAMP * max(stamp.coverage.shape) / max(side, STAMP))))
        for stamp in stamps
    ]
    height, width = (max(dab.shape[axis] for dab in dabs) for axis in (0, 1))
    length = ALONG * max(height, width)
    bare, x, k = np.ones((height, length + width), np.float32), 0.0, 0
    while x <= length:
        dab = dabs[k % len(dabs)]
        top, left = (height - dab.shape[0]) // 2, round(x) + (width - dab.shape[1]) // 2
        bare[top : top + dab.shape[0], left : left + dab.shape[1]] *= 1 - dab
        x += max(1.0, stamps[k % len(stamps)].spacing * max(dab.shape))
        k += 1
    return 1 - bare


def place_of(coverage: np.ndarray) -> tuple[float, float]:
    """Find the row of a mark's axis, and the mark's half width in pixels, ignoring thin starts and stray hairs."""
    full = np.flatnonzero(coverage.mean(1) >= FULL * coverage.mean(1).max())
    middle, half = (full[0] + full[-1] + 1) / 2, (full[-1] + 1 - full[0]) / 2
    return middle, max(half, max(middle, len(coverage) - middle) / (SPREAD * (1 - 4 / ROWS)))


def columns_for(marks: Sequence[Mark]) -> int:
    """Choose the length of the textures in texels so that the median mark roughly keeps its proportions."""
    lengths = [mark.coverage.shape[1] / place_of(mark.coverage)[1] for mark in marks]
    wanted = float(np.median(lengths)) + 2 * (SPREAD - OVER)
    return min(LENGTHS, key=lambda columns: abs(np.log(columns * TEXEL_ASPECT * 2 * SPREAD / ROWS / wanted)))


def texture_of(mark: Mark, columns: int) -> Tensor:
    """Convert a mark to a texture (rows, columns); start and end keep their shape, and the middle can repeat."""
    middle, half = place_of(mark.coverage)
    margin = round((SPREAD - OVER) / (TEXEL_ASPECT * 2 * SPREAD / ROWS))
    height, top = 2 * SPREAD * half, SPREAD * half - middle
    rows = (np.arange(ROWS + 1) / ROWS * height - top).clip(0, len(mark.coverage))
    summed = np.concatenate([np.zeros((1, mark.coverage.shape[1])), mark.coverage.cumsum(0, dtype=np.float64)])
    at = np.stack([np.interp(rows, np.arange(len(summed)), column) for column in summed.T], axis=1)
    means = np.diff(at, axis=0) / (height / ROWS)  # of the pixels under each row of texels
    along = torch.from_numpy(means.astype(np.float32))[None, None]
    body = functional.interpolate(along, (ROWS, columns - 2 * margin), mode="bilinear", antialias=True)[0, 0]
    return close_loop(functional.pad(body.clamp(0, 1), (margin, margin)), loop_of(columns))


def loop_of(columns: int) -> Loop:
    """Return the columns that a long stroke repeats, in the form that ``renderer=textured`` uses."""
    return Loop(3 * columns // 8, 3 * columns // 8)
