"""Judges of pairs and of nodes, order and confidence learn from paintings that the network has not seen."""

from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from brushexp_recovery.calibration import signs_of
from brushexp_recovery.curves import fit_curves
from brushexp_recovery.finding import find_regions
from brushexp_recovery.judges import fit_judge, fit_linear
from brushexp_recovery.looking import LEAST
from brushexp_recovery.maps import predict
from brushexp_recovery.merging import pair_features
from brushexp_recovery.model import RecoveryModel
from brushexp_recovery.network import USUAL
from brushexp_recovery.raster.labels import count_pixels
from brushexp_recovery.raster.overlap import overlaps_between
from brushexp_recovery.raster.resampling import resample
from brushexp_recovery.recover import COPIES
from brushexp_recovery.regions import Pieces, pieces_of
from brushexp_recovery.stacking import meetings_of
from brushexp_recovery.synthesis import Random
from brushexp_recovery.synthesis_ageing import weather
from brushexp_recovery.synthesis_crops import ZOOMS, typical_width
from brushexp_recovery.synthesis_paintings import Painted
from brushexp_recovery.tree import Tree, grow, node_features, overlaps_of

Array = NDArray[Any]
Progress = Callable[[float, str], None]

HIT = 0.5  # IoU at which a region is the stroke
CLEAR = 0.6  # share of a region that one stroke has, for it to be an example
EXAMPLES = 9000  # pairs of one painting and one stage at most
SMALLER = 0.35  # power of the smaller area that an example counts with
STAGES = (0.9, 0.75, 0.5, 0.3)  # chances at which joining is looked at
STEPS = (1500, 3000, 5000)  # of the first and the second judge of pairs, and the judge of nodes
SIDE = 640  # pixels of the parts of paintings that are looked at, zoomed
SPREAD = 0.15  # of the logarithm of their scales


class Known(NamedTuple):
    """A part of a painting in pieces, and the stroke that is seen at each pixel."""

    pieces: Pieces
    truth: Array  # (H, W), -1 is the ground


class Found(NamedTuple):
    """What was found in a painting, and what is known of it."""

    signs: Array  # (N, `CONFIDENCE_FEATURES`) of its regions
    hits: Array  # (N,) whether they are strokes
    meetings: Array  # (P, `ORDER_FEATURES`) of pairs that are strokes
    above: Array  # (P,) whether the second lies above
    strokes: int  # that there are


def fit_judges(model: RecoveryModel, paintings: Iterable[Painted], seed: int, show: Progress) -> dict[str, float]:
    """Fit the judges of a model to paintings, clean and weathered; returns the losses."""
    random = np.random.default_rng(seed)
    known = [known_of(model, painted, aged, random) for painted in paintings for aged in (False, True)]
    show(0.4, "pairs")
    first = [simple_examples(one, random) for one in known]
    losses = {"pairs_first": _fit(model.pairs, first, STEPS[0], seed)}
    asked = model.pairs.asked()
    trees = [grow(one.pieces, asked) for one in known]
    show(0.6, "pairs")
    second = [stage_examples(one, tree, random) for one, tree in zip(known, trees, strict=True)]
    losses["pairs"] = _fit(model.pairs, [*first, *second], STEPS[1], seed)
    asked = model.pairs.asked()
    trees = [grow(one.pieces, asked) for one in known]
    show(0.8, "strokes")
    goals = [node_examples(one, tree) for one, tree in zip(known, trees, strict=True)]
    losses["nodes"] = _fit(model.nodes, goals, STEPS[2], seed)
    return losses


def fit_beliefs(model: RecoveryModel, paintings: Sequence[Painted], seed: int) -> dict[str, float]:
    """Learn which of two regions lies above, and how far regions are to be believed; returns F1 and precision.

    They are found as `recover` finds them, in paintings clean and weathered.
    """
    random = np.random.default_rng(seed)
    found = [found_of(model, painted, aged, random) for painted in paintings for aged in (False, True)]
    signs, hits, meetings, above = (np.concatenate([one[k] for one in found]) for k in range(4))
    fit_linear(model.confidence, signs, hits)
    fit_linear(model.order, meetings, above)
    f1 = 2 * hits.sum() / max(len(hits) + sum(one.strokes for one in found), 1)
    return {"f1": float(f1), "precision": float(hits.sum() / max(len(hits), 1))}


def found_of(model: RecoveryModel, painted: Painted, aged: bool, random: Random) -> Found:
    """Find regions in a part of a painting, and compare them with its strokes."""
    image, truth, _ = part_of(painted, aged, random)
    regions = find_regions(model, image, None, COPIES, lambda *_: None)
    visible = count_pixels(truth, len(painted.geometry))
    strokes, numbers, iou = overlaps_between(truth, regions.labels, len(visible), len(regions.chance))
    partner = np.full(len(regions.chance), -1)
    partner[numbers[iou >= HIT]] = strokes[iou >= HIT]
    pairs, features = meetings_of(regions, fit_curves(regions, image))
    below, upper = partner[pairs].T
    known = (below >= 0) & (upper >= 0) & (below != upper)
    return Found(
        signs_of(regions), partner >= 0, features[known], (upper > below)[known], int((visible >= LEAST).sum())
    )


def known_of(model: RecoveryModel, painted: Painted, aged: bool, random: Random) -> Known:
    """Look at a part of a painting at the scale that suits its strokes, about."""
    image, truth, zoom = part_of(painted, aged, random)
    shown = resample(image, zoom)
    rows, columns = (
        ((np.arange(size) + 0.5) * part / size).astype(int)
        for size, part in zip(shown.shape, truth.shape, strict=False)
    )
    return Known(pieces_of(predict(model.network, shown, 2), shown), truth[np.ix_(rows, columns)])


def part_of(painted: Painted, aged: bool, random: Random) -> tuple[Array, Array, float]:
    """Cut a part out of a painting, `SIDE` pixels wide when zoomed: picture, labels, and the zoom that suits it."""
    zoom = float(np.clip(USUAL / typical_width(painted) * np.exp(random.normal(0, SPREAD)), *ZOOMS))
    height, width = painted.labels.shape
    part = min(round(SIDE / zoom), height, width)
    top, left = int(random.integers(height - part + 1)), int(random.integers(width - part + 1))
    image = painted.image[top : top + part, left : left + part].astype(np.float32) / 255
    image = weather(image, random).astype(np.float32) if aged else image
    return image, painted.labels[top : top + part, left : left + part].astype(int), zoom


def simple_examples(one: Known, random: Random) -> tuple[Array, Array, Array]:
    """Make examples of pairs of pieces, and of regions made by joining what has the highest mean affinity."""
    return stage_examples(one, grow(one.pieces, None, min(STAGES)), random)


def stage_examples(one: Known, tree: Tree, random: Random) -> tuple[Array, Array, Array]:
    """Make examples of the pairs that are there when all likelier ones have been joined: features, goals, weights."""
    parts = [pairs_at(one, tree, stage, random) for stage in (1.1, *STAGES)]
    features, goals, weights = (np.concatenate(column) for column in zip(*parts, strict=True))
    return features, goals[:, None], weights


def pairs_at(one: Known, tree: Tree, stage: float, random: Random) -> tuple[Array, Array, Array]:
    """Make examples of pairs of regions that joining with chances of ``stage`` or more leads to."""
    roots = np.arange(len(tree.sums))
    for number in range(len(tree.children) - 1, -1, -1):
        node = tree.pieces + number
        if roots[node] != node or tree.made[node] >= stage:
            roots[tree.children[number]] = roots[node]
    regions, place = np.unique(roots[: tree.pieces], return_inverse=True)
    count = len(regions)
    sums = np.stack([np.bincount(place, column, minlength=count) for column in one.pieces.sums.T], 1)
    a, b = place[one.pieces.pairs].T
    apart = a != b
    keys = np.minimum(a, b)[apart].astype(np.int64) * count + np.maximum(a, b)[apart]
    pair, where = np.unique(keys, return_inverse=True)
    between = np.stack([np.bincount(where, column, minlength=len(pair)) for column in one.pieces.between[apart].T], 1)
    stroke, share = majority(place[one.pieces.labels], one.truth, count)
    a, b = pair // count, pair % count
    clear = (share[a] > CLEAR) & (share[b] > CLEAR) & (between[:, 4:6].sum(1) + 0.3 * between[:, 6:].sum(1) > 1)
    rows = np.flatnonzero(clear)
    rows = random.choice(rows, EXAMPLES, replace=False) if len(rows) > EXAMPLES else rows
    a, b = a[rows], b[rows]
    weight = np.minimum(sums[a, 0], sums[b, 0]) ** SMALLER
    return pair_features(sums, np.stack([a, b], 1), between[rows]), stroke[a] == stroke[b], weight


def majority(regions: Array, truth: Array, count: int) -> tuple[Array, Array]:
    """Find the stroke that most of each region (``count``,) belongs to, and its share; -1 is the ground."""
    most = int(truth.max()) + 2
    key, number = np.unique(regions.ravel().astype(np.int64) * most + truth.ravel() + 1, return_counts=True)
    region, stroke = key // most, key % most - 1
    order = np.lexsort((-number, region))
    first = order[np.r_[True, region[order][1:] != region[order][:-1]]]
    winner, share = np.full(count, -1), np.zeros(count)
    winner[region[first]] = stroke[first]
    share[region[first]] = number[first] / np.bincount(regions.ravel(), minlength=count)[region[first]]
    return winner, share


def node_examples(one: Known, tree: Tree) -> tuple[Array, Array, Array]:
    """Make examples of nodes: is it a stroke, and what is its IoU with the nearest one."""
    enough = tree.sums[:, 0] >= LEAST
    overlap = overlaps_of(tree, one.pieces.labels, one.truth, int(one.truth.max()) + 1).max(1, initial=0)[enough]
    return node_features(tree)[enough], np.stack([overlap >= HIT, overlap], 1), np.ones(int(enough.sum()))


def _fit(judge: Any, examples: list[tuple[Array, Array, Array]], steps: int, seed: int) -> float:
    features, goals, weights = (np.concatenate(column) for column in zip(*examples, strict=True))
    return fit_judge(judge, features, goals, weights, steps, seed)
