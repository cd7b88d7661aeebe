"""Make the benchmark's paintings and their ground truth from a seed, with different subjects, brushes and densities."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any
from zlib import crc32

import numpy as np
import torch
from numpy.typing import NDArray

from brushexp.contracts.strokes import Saved, curve_of
from brushexp_recovery.benchmark.brushes import BRUSHES, draw_with
from brushexp_recovery.benchmark.subjects import make_subject, prime_canvas
from brushexp_recovery.benchmark.truth import Truth, truth_from
from brushexp_recovery.curves.round_line import trim_to_paint
from brushexp_recovery.raster.jpeg import compress_as_jpeg
from brushexp_recovery.synthesis.ageing import weather
from brushexp_recovery.synthesis.canvas import Canvas, compose, opaque_mixing
from brushexp_recovery.synthesis.families.family import find_families, paint_family
from brushexp_recovery.synthesis.hand import Hand
from brushexp_recovery.synthesis.layout import StrokeLayout, lay_strokes
from brushexp_recovery.synthesis.windows import BrushLook, StrokeWindows, draw_strokes

Array = NDArray[Any]

SEED = 20_251_125  # not used in any training
COATS = 4.0
MOST_FLUID = 600  # maximum number of strokes from the bristle simulator, which take a minute
HARD_QUALITY = 75  # JPEG quality of hard photographs
LOOKS = {
    "textured": BrushLook("renderer", "textured", {}),
    "fluid": BrushLook("engine", "fluid", {"brushes": 8}),
}
PAINTERS = ("hertzmann", "litwinowicz")  # painters whose strokes are drawn with the bristles of ``textured``
SEEN = tuple(LOOKS)  # kinds that occur in training with other subjects and seeds
UNSEEN = (*BRUSHES, *PAINTERS)
KINDS = (*SEEN, *UNSEEN)


@dataclass(frozen=True)
class Scene:
    """A benchmark painting, specified by its kind, its number of strokes and a running number."""

    kind: str
    count: int  # requested number of strokes
    number: int = 0  # number among similar scenes

    @property
    def name(self) -> str:
        """File name of the scene, without a suffix."""
        return f"{self.kind}-{self.count}" + f"-{self.number}" * (self.number > 0)


@dataclass(frozen=True)
class ScenePainting:
    """A painting with its ground truth, as a clean picture and a degraded photograph, both (H, W, 3) in [0, 1]."""

    truth: Truth
    clean: Array
    hard: Array


def list_scenes(kinds: Sequence[str], counts: Sequence[int], repeats: int) -> list[Scene]:
    """List ``repeats`` scenes for each kind and density, except densities that would take the simulator too long."""
    pairs = [(kind, count) for kind in kinds for count in counts if kind != "fluid" or count <= MOST_FLUID]
    return [Scene(kind, count, number) for kind, count in pairs for number in range(repeats)]


def paint_scene(scene: Scene, side: int, seed: int = SEED) -> ScenePainting:
    """Paint a scene in ``side`` x ``side`` pixels; the result depends only on the arguments."""
    random = np.random.default_rng([seed, _number_of(scene.kind), scene.count, scene.number])
    subject = make_subject(side, random)
    if scene.kind in find_families():
        ground = prime_canvas(subject, random).astype(np.float32)
        painting = paint_family(scene.kind, subject.astype(np.float32), scene.count, ground, random)
        clean = np.round(255 * painting.image.astype(float)) / 255
        truth = truth_of(painting.windows, painting.canvas, painting.layout, clean)
        return ScenePainting(truth, clean, photograph(painting.image, random))
    layout = lay_scene(scene.kind, subject, scene.count, random)
    if scene.kind in BRUSHES:
        coats = 1.0
        windows = draw_with(scene.kind, layout, random)
    else:
        coats = COATS
        windows = draw_strokes(layout, LOOKS.get(scene.kind, LOOKS["textured"]), int(random.integers(2**31)))
    ground = prime_canvas(subject, random).astype(np.float32)
    canvas = compose(windows, layout, opaque_mixing(len(layout), coats), ground)
    clean = np.round(255 * canvas.image.astype(float)) / 255
    return ScenePainting(truth_of(windows, canvas, layout, clean), clean, photograph(canvas.image, random))


def photograph(image: Array, random: np.random.Generator) -> Array:
    """Simulate a degraded photograph of a painting (H, W, 3), with canvas weave, blur, noise and JPEG artefacts."""
    return compress_as_jpeg(np.clip(weather(image, random), 0, 1), HARD_QUALITY)


def _number_of(kind: str) -> int:
    """Return the number that represents a kind in seeds: its index in `KINDS`, or a checksum of its name."""
    return KINDS.index(kind) if kind in KINDS else crc32(kind.encode())


def lay_scene(kind: str, subject: Array, count: int, random: np.random.Generator) -> StrokeLayout:
    """Place about ``count`` strokes, either in layers along edges or with one of the painters."""
    if kind not in PAINTERS:
        return lay_strokes(subject.astype(np.float32), count, Hand(), random)
    import brushexp  # noqa: PLC0415

    words: dict[str, Any] = {"painter": kind, "frames": 0, "max_strokes": count, "seed": int(random.integers(2**31))}
    painting = brushexp.paint(subject.astype(np.float32), look="even", strokes=count, report=False, **words)
    return layout_of(painting.finished.job.saved)


def layout_of(saved: Saved) -> StrokeLayout:
    """Convert the strokes of a catalogue to a layout, bottom to top."""
    strokes = saved.strokes[saved.depth.argsort()].map(torch.Tensor.double)
    curve, width = curve_of(strokes).numpy(), (strokes.width * strokes.scale).numpy()
    unbent = np.zeros(len(width))
    return StrokeLayout(curve, width, strokes.color.numpy(), sway=unbent, taper=unbent)


def truth_of(windows: StrokeWindows, canvas: Canvas, layout: StrokeLayout, image: Array) -> Truth:
    """Compute the ground truth for strokes on a canvas."""
    area, _, _, first, last, _ = canvas.extent.T
    curve, width = trim_to_paint(windows.curve.astype(float), 0.5 * (first + 1), 0.5 * (last + 1), np.maximum(area, 1))
    return truth_from(canvas.labels, area, curve, width, layout.color, image)
