"""List mixtures of a few tubes in simple proportions, and choose the mixtures that a picture needs."""

from dataclasses import dataclass
from itertools import combinations, product
from math import gcd

import numpy as np
import torch
from torch import Tensor

from brushexp.contracts.pictures import decode_srgb, encode_srgb, to_lab
from brushexp_changes.tubes.paints import Tubes

Array = np.ndarray
PARTS = (1, 2, 3, 4, 6, 8, 12, 16)  # possible parts of a tube in a mixture of two tubes
PARTS_OF_THREE = (1, 2, 3, 4, 8)  # possible parts of a tube in a mixture of three tubes
NEAREST = 6  # candidate mixtures per colour
BINS = 20  # bins per channel for counting the colours of a picture
GREY = 5.0  # CIELAB chroma up to which a mixture counts as grey
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # weights of linear sRGB
ROUNDS = 30  # upper bound on rounds of exchanging mixtures; a few suffice


@dataclass(frozen=True, eq=False)
class Mixtures:
    """M mixtures: integer ``parts`` (M, T) of each tube, and sRGB colours ``color`` (M, 3) in [0, 1], float32."""

    tubes: tuple[str, ...]
    parts: Array
    color: Tensor

    def __len__(self) -> int:
        return len(self.parts)

    def __getitem__(self, index: Array) -> "Mixtures":
        return Mixtures(self.tubes, self.parts[index], self.color[torch.from_numpy(np.asarray(index))])

    def from_dark(self) -> "Mixtures":
        """Sort the mixtures from dark to light."""
        return self[np.argsort(to_lab(self.color.double().numpy())[:, 0], kind="stable")]

    def recipe(self, number: int) -> str:
        """Write a mixture in words: ``3 titanium white + 1 bone black``."""
        parts = [(count, tube) for count, tube in zip(self.parts[number].tolist(), self.tubes, strict=True) if count]
        return parts[0][1] if len(parts) == 1 else " + ".join(f"{count} {tube}" for count, tube in parts)


def all_mixtures(tubes: Tubes) -> Mixtures:
    """List every mixture of one to three tubes in simple proportions, without duplicates."""
    rows = [*np.eye(len(tubes), dtype=int)]
    for count, amounts in ((2, PARTS), (3, PARTS_OF_THREE)):
        simple = [each for each in product(amounts, repeat=count) if gcd(*each) == 1]
        for chosen in combinations(range(len(tubes)), count):
            block = np.zeros((len(simple), len(tubes)), dtype=int)
            block[:, chosen] = simple
            rows.extend(block)
    parts = np.stack(rows)
    return Mixtures(tubes.names, parts, torch.from_numpy(tubes.mix(parts)).float())


def differences(first: Array, second: Array) -> Array:
    """Compute the CIEDE2000 differences (N, M) between sRGB colours (N, 3) and (M, 3)."""
    from skimage.color import deltaE_ciede2000  # noqa: PLC0415  (slow to import)

    return np.asarray(deltaE_ciede2000(to_lab(first)[:, None], to_lab(second)[None]))


def counted_colors(picture: Tensor) -> tuple[Array, Array]:
    """Bin the colours of a picture (3, H, W); return the mean colour (N, 3) and pixel count (N,) of each bin."""
    colors = picture.flatten(1).T.double().numpy()
    bins = (colors * BINS).astype(int).clip(0, BINS - 1) @ (BINS**2, BINS, 1)
    _, which, count = np.unique(bins, return_inverse=True, return_counts=True)
    sums = np.stack([np.bincount(which, channel) for channel in colors.T], axis=1)
    return sums / count[:, None], count


def near(candidates: Mixtures, colors: Array) -> Mixtures:
    """Keep the mixtures that are among the ``NEAREST`` neighbours of any of the colours (N, 3) in CIELAB."""
    from scipy.spatial import KDTree  # noqa: PLC0415  (slow to import)

    tree = KDTree(to_lab(candidates.color.double().numpy()))
    found = tree.query(to_lab(colors), min(NEAREST, len(candidates)))[1]
    return candidates[np.unique(found)]


def choose_mixtures(candidates: Mixtures, picture: Tensor, count: int) -> Mixtures:
    """Choose up to ``count`` mixtures that minimise the mean CIEDE2000 difference from a picture (3, H, W).

    Mixtures are added greedily. Then each mixture is replaced by the best mixture for the pixels nearest to it, until
    nothing changes (k-medoids). The result is sorted from dark to light.
    """
    colors, weight = counted_colors(picture)
    candidates = near(candidates, colors)
    away = differences(colors, candidates.color.double().numpy()) * weight[:, None]
    chosen, nearest = [], np.full(len(colors), np.inf)
    for _ in range(min(count, len(candidates))):
        chosen.append(int(np.minimum(nearest[:, None], away).sum(0).argmin()))
        nearest = np.minimum(nearest, away[:, chosen[-1]])
    for _ in range(ROUNDS):
        whose, before = away[:, chosen].argmin(1), chosen
        chosen = [int(away[whose == k].sum(0).argmin()) if (whose == k).any() else old for k, old in enumerate(before)]
        if chosen == before:
            break
    return candidates[np.unique(chosen)].from_dark()


def map_tones(picture: Tensor, mixtures: Mixtures) -> Tensor:
    """Map the luminance of a picture (3, H, W) to the range between the mixtures' darkest and lightest grey.

    This is the black point compensation used in printing (ISO 18619, 2015), applied to the white point as well. It is
    linear in light and therefore preserves hues.
    """
    colors = mixtures.color.double().numpy()
    chroma = np.hypot(*to_lab(colors)[:, 1:].T)
    luminance = decode_srgb(colors)[chroma <= max(GREY, chroma.min())] @ LUMINANCE
    mapped = luminance.min() + np.ptp(luminance) * decode_srgb(picture.double().cpu().numpy())
    return torch.from_numpy(np.asarray(encode_srgb(mapped))).to(picture)
