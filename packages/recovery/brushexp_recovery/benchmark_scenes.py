"""The paintings of the benchmark: subjects, brushes and densities, each made from a seed, with its truth."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from brushexp.strokes.bezier import curve_of
from brushexp.strokes.saved import Saved
from brushexp_recovery.benchmark_brushes import BRUSHES, draw_with
from brushexp_recovery.raster.jpeg import compress_as_jpeg
from brushexp_recovery.synthesis import Hand, Laid, lay_strokes
from brushexp_recovery.synthesis_ageing import weather
from brushexp_recovery.synthesis_canvas import Composed, Mixing, compose
from brushexp_recovery.synthesis_looks import Drawn, Look, draw_strokes
from brushexp_recovery.truth import Truth, painted_part, truth_from

Array = NDArray[Any]

SEED = 20_251_125  # no training has this one
FIELDS = 7  # of a subject
GAMUT = 42.0  # of its colours, a and b of CIELAB: more is not in sRGB
COATS = 4.0
MOST_FLUID = 600  # strokes of the simulator of bristles, which take a minute
HARD_QUALITY = 75  # of JPEG
LOOKS = {
    "textured": Look("renderer", "textured", {}),
    "fluid": Look("engine", "fluid", {"brushes": 8}),
}
PAINTERS = ("hertzmann", "litwinowicz")  # whose strokes are drawn with the bristles of ``textured``
SEEN = tuple(LOOKS)  # of which training has some, from other subjects and seeds
UNSEEN = (*BRUSHES, *PAINTERS)
KINDS = (*SEEN, *UNSEEN)


@dataclass(frozen=True)
class Scene:
    """A painting of the benchmark."""

    kind: str
    count: int  # strokes that were asked for
    number: int = 0  # of several that are alike

    @property
    def name(self) -> str:
        """Name it for files."""
        return f"{self.kind}-{self.count}" + f"-{self.number}" * (self.number > 0)


@dataclass(frozen=True)
class Painted:
    """A painting with its truth, clean and as a hard photograph of it; pictures (H, W, 3) in [0, 1]."""

    truth: Truth
    clean: Array
    hard: Array


def paint(scene: Scene, side: int, seed: int = SEED) -> Painted:
    """Paint a scene of ``side`` x ``side`` pixels; the same for the same scene, side and seed."""
    random = np.random.default_rng([seed, KINDS.index(scene.kind), scene.count, scene.number])
    subject = subject_of(side, random)
    laid = laid_by(scene.kind, subject, scene.count, random)
    if scene.kind in BRUSHES:
        drawn = draw_with(scene.kind, laid, random)
    else:
        look = LOOKS.get(scene.kind, LOOKS["textured"])
        drawn = draw_strokes(laid, look, int(random.integers(2**31)))
    coats = 1.0 if scene.kind in BRUSHES else COATS
    mixing = Mixing(coats, np.ones(len(laid.width)), np.zeros(len(laid.width)))
    composed = compose(drawn, laid, mixing, ground_of(subject, random).astype(np.float32))
    clean = np.round(255 * composed.image.astype(float)) / 255
    hard = compress_as_jpeg(np.clip(weather(composed.image, random), 0, 1), HARD_QUALITY)
    return Painted(truth_of(drawn, composed, laid, clean), clean, hard)


def subject_of(side: int, random: np.random.Generator) -> Array:
    """Make something to paint, (side, side, 3): fields of colours that flow into each other, with edges between."""
    from skimage.color import lab2rgb  # noqa: PLC0415  (slow to import)

    def noise(sigma: float) -> Array:
        values = gaussian_filter(random.normal(size=(side, side)), sigma * side, mode="wrap")
        return values / values.std()

    bend = np.stack([noise(0.08), noise(0.08)], -1) * 0.04 * side
    rows, columns = np.mgrid[:side, :side]
    centres = random.random((FIELDS, 2)) * side
    places = np.stack([rows, columns], -1) + bend
    field = ((places[:, :, None] - centres) ** 2).sum(-1).argmin(-1)
    lab = np.stack([random.uniform(25, 85, FIELDS), *random.normal(0, 26, (2, FIELDS))], -1)[field]
    lab = lab + np.stack([9 * noise(0.05), 7 * noise(0.07), 7 * noise(0.07)], -1)
    lab = lab.clip([15, -GAMUT, -GAMUT], [92, GAMUT, GAMUT])
    return np.clip(lab2rgb(lab), 0, 1)


def laid_by(kind: str, subject: Array, count: int, random: np.random.Generator) -> Laid:
    """Lay some ``count`` strokes: in layers along the edges, or as a painter of the program does."""
    if kind not in PAINTERS:
        return lay_strokes(subject.astype(np.float32), count, Hand(), random)
    import brushexp  # noqa: PLC0415

    words: dict[str, Any] = {"painter": kind, "frames": 0, "max_strokes": count, "seed": int(random.integers(2**31))}
    painting = brushexp.paint(subject.astype(np.float32), look="even", strokes=count, report=False, **words)
    return laid_from(painting.finished.job.saved)


def laid_from(saved: Saved) -> Laid:
    """Take the strokes of a catalogue, bottom to top."""
    up = saved.depth.argsort()
    strokes = saved.strokes[up].map(torch.Tensor.double)
    curve, none = curve_of(strokes).numpy(), np.zeros(len(up))
    return Laid(curve, (strokes.width * strokes.scale).numpy(), strokes.color.numpy(), none, none)


def ground_of(subject: Array, random: np.random.Generator) -> Array:
    """Prime a canvas of any colour with some of the subject, and grain."""
    bare = random.uniform(0.35, 0.9, 3) if random.random() < 0.7 else np.full(3, random.uniform(0.5, 0.95))
    wash = gaussian_filter(subject, (40, 40, 0))
    grain = gaussian_filter(random.normal(size=subject.shape[:2]), 2)
    return np.clip((0.75 * bare + 0.25 * wash) * (1 + 0.02 * (grain / grain.std())[..., None]), 0, 1)


def truth_of(drawn: Drawn, composed: Composed, laid: Laid, image: Array) -> Truth:
    """Say what is known of composed strokes."""
    area, _, _, low, high, _ = composed.extent.T
    curve, width = painted_part(drawn.curve.astype(float), 0.5 * (low + 1), 0.5 * (high + 1), np.maximum(area, 1))
    return truth_from(composed.labels, area, curve, width, laid.color, image)


def scenes_of(kinds: Sequence[str], counts: Sequence[int], repeats: int) -> list[Scene]:
    """List scenes: each kind at each density, ``repeats`` times, but no more bristles than can be simulated."""
    pairs = [(kind, count) for kind in kinds for count in counts if kind != "fluid" or count <= MOST_FLUID]
    return [Scene(kind, count, number) for kind, count in pairs for number in range(repeats)]
