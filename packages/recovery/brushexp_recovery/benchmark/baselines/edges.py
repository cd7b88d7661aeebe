"""Find brushstrokes between edges (Li, Yao, Hendriks and Wang, 2012, "Rhythmic brushstrokes distinguish van Gogh").

Gaps in the detected edges are closed so that they enclose regions. A region is a brushstroke if its skeleton hardly
branches and its breadth and area are consistent with its length. The remaining pixels are divided by k-means clustering
of their colours and tested in the same way. Unlike in the source, edges are detected by Canny's method (1986), not
EDISON.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp_recovery.raster.offsets import pair_slices

Array = NDArray[Any]

SIGMA = 1.0  # standard deviation in pixels of the smoothing before edge detection
CLOSING_RADIUS = 1  # radius in pixels of the closing of gaps in edges
SMALLEST_REGION = 20  # pixels
LARGEST_REGION = 0.05  # share of the picture
BRANCHES = 0.35  # maximum share of a skeleton beyond its longest path
BREADTH = (0.05, 1.0)  # range of width / length
FILL = (0.5, 2.0)  # range of area / (length x width)
COLORS = 12  # number of k-means clusters
COLOR_SAMPLE = 4000  # number of pixels from which the clusters are computed
GROWTH = 2  # pixels that a stroke may grow into edges
NEIGHBOURS = ((0, 1), (1, 0), (1, 1), (1, -1))  # offsets (row, column) to half of a pixel's eight neighbours


def strokes_between_edges(image: Array) -> Array:
    """Label the brushstrokes in a picture (H, W, 3); labels (H, W) are -1 where there is none."""
    from skimage.color import rgb2lab  # noqa: PLC0415  (slow to import)
    from skimage.feature import canny  # noqa: PLC0415
    from skimage.measure import label  # noqa: PLC0415
    from skimage.morphology import dilation, disk  # noqa: PLC0415

    lab = rgb2lab(image)
    lines = np.any([canny(lab[..., channel] / 100, SIGMA, 0.02, 0.06) for channel in range(3)], axis=0)
    closed = dilation(lines, disk(CLOSING_RADIUS))
    enclosed = keep_brushstrokes(label(~closed, connectivity=1))
    rest = np.where(enclosed >= 0, -1, quantise_colors(lab))
    of_one_color = keep_brushstrokes(label(rest + 1, connectivity=1, background=0))
    labels = np.where(of_one_color >= 0, of_one_color + enclosed.max() + 1, -1)
    return grow_into_edges(np.where(enclosed >= 0, enclosed, labels))


def keep_brushstrokes(regions: Array) -> Array:
    """Keep the regions (H, W; 0 for none) that are brushstrokes, number them from 0, and set other pixels to -1."""
    from skimage.measure import regionprops  # noqa: PLC0415  (slow to import)

    labels, count = np.full(regions.shape, -1, np.int32), 0
    for region in regionprops(regions):
        if SMALLEST_REGION <= region.area <= LARGEST_REGION * regions.size and is_brushstroke(region.image):
            labels[region.slice][region.image] = count
            count += 1
    return labels


def is_brushstroke(mask: Array) -> bool:
    """Check whether a region (h, w) has a skeleton with few branches, and consistent length, breadth and area."""
    from scipy.ndimage import distance_transform_edt  # noqa: PLC0415  (slow to import)
    from skimage.morphology import skeletonize  # noqa: PLC0415

    padded = np.pad(mask, 1)
    skeleton = skeletonize(padded)
    path = longest_path(skeleton)
    width = 2 * float(distance_transform_edt(padded)[skeleton].mean()) if skeleton.any() else 1.0
    length = path + width  # a skeleton ends half a breadth before the end of the stroke
    branches = 1 - (path + 1) / max(float(skeleton.sum()), 1)
    return (
        branches <= BRANCHES
        and BREADTH[0] <= width / length <= BREADTH[1]
        and FILL[0] <= mask.sum() / (length * width) <= FILL[1]
    )


def longest_path(skeleton: Array) -> float:
    """Count the steps between the two pixels of a skeleton (h, w) that are farthest apart along it."""
    from scipy.sparse import coo_matrix  # noqa: PLC0415  (slow to import)
    from scipy.sparse.csgraph import dijkstra  # noqa: PLC0415

    count = int(skeleton.sum())
    if count < 2:
        return 0.0
    number: Array = np.full(skeleton.shape, -1)
    number[skeleton] = np.arange(count)
    pairs = []
    for offset in NEIGHBOURS:
        here, there = pair_slices(skeleton.shape, offset)
        both = skeleton[here] & skeleton[there]
        pairs.append(np.stack([number[here][both], number[there][both]]))
    rows, columns = np.concatenate(pairs, axis=1)
    graph = coo_matrix((np.ones(len(rows)), (rows, columns)), shape=(count, count)).tocsr()
    from_any = dijkstra(graph, directed=False, unweighted=True, indices=0)
    end = int(np.where(np.isfinite(from_any), from_any, -1).argmax())
    from_end = dijkstra(graph, directed=False, unweighted=True, indices=end)
    return float(from_end[np.isfinite(from_end)].max())


def quantise_colors(lab: Array) -> Array:
    """Divide the colours of a CIELAB picture into `COLORS` clusters, and label each pixel (H, W) with its cluster."""
    from scipy.cluster.vq import kmeans2, vq  # noqa: PLC0415  (slow to import)

    pixels = lab.reshape(-1, 3)
    sample = pixels[np.random.default_rng(0).permutation(len(pixels))[:COLOR_SAMPLE]]
    centres, _ = kmeans2(sample, min(COLORS, len(sample)), minit="++", seed=0)
    nearest, _ = vq(pixels, centres)
    number: Array = nearest.reshape(lab.shape[:2])
    return number


def grow_into_edges(labels: Array) -> Array:
    """Extend labelled strokes (H, W) to unlabelled pixels at most `GROWTH` pixels away."""
    from scipy.ndimage import distance_transform_edt  # noqa: PLC0415  (slow to import)

    distance, nearest = distance_transform_edt(labels < 0, return_indices=True)
    return np.where(distance <= GROWTH, labels[tuple(nearest)], -1)
