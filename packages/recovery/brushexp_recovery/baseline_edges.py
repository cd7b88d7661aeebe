"""Brushstrokes between edges, after Li, Yao, Hendriks and Wang (2012), "Rhythmic brushstrokes distinguish van Gogh".

Edges are found, closed, and enclose regions; a region is a brushstroke if its skeleton hardly branches and if its
breadth and area go with its length. What is left is divided by k-means of its colours, and tested in the same way.
Differs from the source: edges are Canny's (1986), not those of EDISON.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

SIGMA = 1.0  # pixels: of the smoothing before edges are found
CLOSE = 1  # pixels: radius by which gaps of edges are closed
LEAST, MOST = 20, 0.05  # pixels, and share of the picture, of a region
BRANCHED = 0.35  # share of a skeleton beyond its longest way, at most
BREADTH = (0.05, 1.0)  # width / length
FILLED = (0.5, 2.0)  # area / (length x width)
COLORS = 12  # of k-means
SAMPLE = 4000  # pixels from which the colours are learned
GIVEN_BACK = 2  # pixels that a stroke may grow into edges


def edges_and_test(image: Array) -> Array:
    """Find brushstrokes in a picture (H, W, 3): labels (H, W), -1 where there is none."""
    from skimage.color import rgb2lab  # noqa: PLC0415  (slow to import)
    from skimage.feature import canny  # noqa: PLC0415
    from skimage.measure import label  # noqa: PLC0415
    from skimage.morphology import dilation, disk  # noqa: PLC0415

    lab = rgb2lab(image)
    lines = np.any([canny(lab[..., channel] / 100, SIGMA, 0.02, 0.06) for channel in range(3)], axis=0)
    closed = dilation(lines, disk(CLOSE))
    first = tested(label(~closed, connectivity=1))
    rest = np.where(first >= 0, -1, nearest_color(lab))
    second = tested(label(rest + 1, connectivity=1, background=0))
    joined = np.where(first >= 0, first, np.where(second >= 0, second + first.max() + 1, -1))
    return grown(joined)


def tested(regions: Array) -> Array:
    """Number the regions (H, W; 0 is none) that are brushstrokes from 0; the others become -1."""
    from skimage.measure import regionprops  # noqa: PLC0415  (slow to import)

    labels, count = np.full(regions.shape, -1, np.int32), 0
    for region in regionprops(regions):
        if LEAST <= region.area <= MOST * regions.size and is_brushstroke(region.image):
            labels[region.slice][region.image] = count
            count += 1
    return labels


def is_brushstroke(mask: Array) -> bool:
    """Test a region (h, w): its skeleton is one way, and length, breadth and area go together."""
    from scipy.ndimage import distance_transform_edt  # noqa: PLC0415  (slow to import)
    from skimage.morphology import skeletonize  # noqa: PLC0415

    room = np.pad(mask, 1)
    skeleton = skeletonize(room)
    way = longest_way(skeleton)
    width = 2 * float(distance_transform_edt(room)[skeleton].mean()) if skeleton.any() else 1.0
    length = way + width  # a skeleton ends half a breadth before the stroke
    branched = 1 - (way + 1) / max(float(skeleton.sum()), 1)
    return (
        branched <= BRANCHED
        and BREADTH[0] <= width / length <= BREADTH[1]
        and FILLED[0] <= mask.sum() / (length * width) <= FILLED[1]
    )


def longest_way(skeleton: Array) -> float:
    """Count the steps of the longest shortest way in a skeleton (h, w)."""
    from scipy.sparse import coo_matrix  # noqa: PLC0415  (slow to import)
    from scipy.sparse.csgraph import dijkstra  # noqa: PLC0415

    number: Array = np.full(skeleton.shape, -1)
    height, width = skeleton.shape
    count = int(skeleton.sum())
    number[skeleton] = np.arange(count)
    if count < 2:
        return 0.0
    pairs = []
    for dy, dx in ((0, 1), (1, 0), (1, 1), (1, -1)):
        a = number[: height - dy, max(-dx, 0) : width - max(dx, 0)]
        b = number[dy:, max(dx, 0) : width + min(dx, 0)]
        both = (a >= 0) & (b >= 0)
        pairs.append(np.stack([a[both], b[both]]))
    rows, columns = np.concatenate(pairs, axis=1)
    graph = coo_matrix((np.ones(len(rows)), (rows, columns)), shape=(count, count)).tocsr()
    far = dijkstra(graph, directed=False, unweighted=True, indices=0)
    end = int(np.where(np.isfinite(far), far, -1).argmax())
    again = dijkstra(graph, directed=False, unweighted=True, indices=end)
    return float(again[np.isfinite(again)].max())


def nearest_color(lab: Array) -> Array:
    """Number the pixels (H, W) of a picture in CIELAB by the nearest of `COLORS` colours."""
    from scipy.cluster.vq import kmeans2, vq  # noqa: PLC0415  (slow to import)

    pixels = lab.reshape(-1, 3)
    sample = pixels[np.random.default_rng(0).permutation(len(pixels))[:SAMPLE]]
    centres, _ = kmeans2(sample, min(COLORS, len(sample)), minit="++", seed=0)
    number: Array = vq(pixels, centres)[0].reshape(lab.shape[:2])
    return number


def grown(labels: Array) -> Array:
    """Give strokes (H, W) back what lies within `GIVEN_BACK` pixels of them and is of none."""
    from scipy.ndimage import distance_transform_edt  # noqa: PLC0415  (slow to import)

    far, nearest = distance_transform_edt(labels < 0, return_indices=True)
    around: Array = labels[tuple(nearest)]
    return np.where(far <= GIVEN_BACK, around, -1)
