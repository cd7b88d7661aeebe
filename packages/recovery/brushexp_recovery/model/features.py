"""Define the features of the perceptrons and logistic models, in the order of the learned weights.

In the names of features, ``LOG`` stands for a natural logarithm, and ``AFFINITY`` for a mean over pairs of pixels.
Lengths and widths are relative to the stroke's predicted length and width, unless their names contain ``PREDICTED``.
"""

from enum import IntEnum


class PairFeature(IntEnum):
    """Features of two neighbouring regions; the smaller is ``SMALL``, the larger ``LARGE`` and their union ``BOTH``."""

    AFFINITY_ADJACENT = 0  # mean between the regions over offsets of 1 pixel
    AFFINITY_3 = 1  # mean over offsets of 3 pixels
    AFFINITY_8 = 2
    AFFINITY_20 = 3
    LOG_PAIRS_ADJACENT = 4  # number of pairs of pixels
    LOG_PAIRS_3 = 5
    LOG_PAIRS_8 = 6
    LOG_PAIRS_20 = 7
    AFFINITY = 8  # mean over all offsets
    LOG_AREA_SMALL = 9
    LOG_AREA_LARGE = 10
    LIGHTNESS_GAP = 11  # difference of the mean colours in CIELAB
    A_GAP = 12
    B_GAP = 13
    COLOR_GAP = 14
    COLOR_SPREAD_SMALL = 15  # standard deviation of the colour in CIELAB
    COLOR_SPREAD_LARGE = 16
    LOG_CENTRE_GAP = 17  # distance of the predicted centres, in widths
    CENTRE_GAP_BY_SPREAD = 18
    LOG_SPREAD_SMALL = 19  # standard deviation of the predicted centre, in widths
    LOG_SPREAD_LARGE = 20
    COHERENCE_SMALL = 21  # coherence of the predicted directions, 0 to 1
    COHERENCE_LARGE = 22
    DIRECTION_AGREEMENT = 23  # agreement of both predicted directions, -1 to 1
    ALIGNMENT_BOTH = 24  # alignment of the shape with the predicted direction, -1 to 1
    WIDTH_GAP = 25  # difference of the logarithms of the predicted widths
    LENGTH_GAP = 26
    LOG_FILL = 27  # area relative to a rectangle with the predicted sides
    VISIBLE = 28  # predicted share of the stroke that is visible
    LOG_FILL_BY_VISIBLE = 29
    LOG_LENGTH_BOTH = 30
    LOG_WIDTH_BOTH = 31
    LOG_LENGTH_SMALL = 32
    LOG_LENGTH_LARGE = 33
    LOG_WIDTH_SMALL = 34
    LOG_WIDTH_LARGE = 35
    LOG_LENGTH_GAIN = 36  # length of the union relative to the larger region
    LOG_WIDTH_GAIN = 37
    LOG_COMPACTNESS_BOTH = 38  # area relative to the rectangle with the same moments
    LOG_COMPACTNESS_LARGE = 39
    LOG_DISTANCE = 40  # distance of the middles, in widths
    LOG_CONTACT = 41  # adjacent pairs of pixels, divided by the root of the smaller area
    PAINT_SMALL = 42  # share of pixels that are paint
    PAINT_LARGE = 43
    LOG_PREDICTED_WIDTH = 44


class NodeFeature(IntEnum):
    """Features of a merge-tree node, which describe its region, its merge and its surroundings."""

    LOG_AREA = 0
    AFFINITY_INSIDE_ADJACENT = 1
    AFFINITY_INSIDE_3 = 2
    AFFINITY_INSIDE_8 = 3
    AFFINITY_INSIDE_20 = 4
    AFFINITY_OUTSIDE_ADJACENT = 5  # mean affinity to other regions
    AFFINITY_OUTSIDE_3 = 6
    AFFINITY_OUTSIDE_8 = 7
    AFFINITY_OUTSIDE_20 = 8
    MERGE_CHANCE = 9  # chance at which its two parts were merged
    NEIGHBOUR_CHANCE = 10  # highest chance of being merged with a neighbour
    CHANCE_GAP = 11
    LOG_LIGHTNESS_SPREAD = 12  # standard deviation of lightness in CIELAB
    LOG_A_SPREAD = 13
    LOG_B_SPREAD = 14
    LOG_SPREAD = 15  # standard deviation of the predicted centre, in widths
    COHERENCE = 16  # coherence of the predicted directions, 0 to 1
    ALIGNMENT = 17  # alignment of the shape with the predicted direction, -1 to 1
    LOG_CENTRE_GAP = 18  # distance of the middle from the predicted centre, in widths
    CENTRE_GAP_BY_LENGTH = 19
    LOG_FILL = 20  # area relative to a rectangle with the predicted sides
    VISIBLE = 21  # predicted share of the stroke that is visible
    LOG_FILL_BY_VISIBLE = 22
    LOG_LENGTH = 23
    LOG_WIDTH = 24
    LOG_COMPACTNESS = 25  # area relative to the rectangle with the same moments
    LOG_ELONGATION = 26
    LOG_PREDICTED_WIDTH = 27
    LOG_PREDICTED_LENGTH = 28
    PREDICTED_WIDTH_SPREAD = 29  # standard deviation of the logarithm
    PREDICTED_LENGTH_SPREAD = 30
    PAINT = 31  # share of pixels that are paint
    LOG_CONTACT_ADJACENT = 32  # pairs of pixels with other regions, divided by the root of the area
    LOG_CONTACT_3 = 33
    LOG_CONTACT_20 = 34  # number of pairs divided by the area


class NodeScore(IntEnum):
    """Outputs of the node perceptron."""

    MATCH = 0  # chance of an intersection over union of 0.5 or more with a stroke
    IOU = 1  # expected intersection over union with the nearest stroke


class OrderFeature(IntEnum):
    """Evidence that the second of two touching regions is above the first; swapping the regions flips every sign."""

    OCCLUSION = 0  # mean log-odds of the network, times the root of the number of pixels
    OCCLUSION_VOTES = 1  # the same as soft votes, -1 to 1
    CROSSING = 2  # share of the second minus the first where the whole strokes overlap, -1 to 1
    CROSSING_PIXELS = 3  # the same, times the root of the number of pixels
    VISIBLE = 4  # difference of the predicted visible shares
    LOG_FILL = 5  # difference of the areas relative to the predicted sides
    LOG_WIDTH = 6  # difference of the widths
    LOG_AREA = 7  # difference of the areas
    CHANCE = 8  # difference of the chances of being a stroke


class ConfidenceFeature(IntEnum):
    """Features from which a model predicts whether a region is a stroke."""

    LOG_ODDS = 0  # log-odds of the chance over all looks
    VISIBLE = 1  # predicted share of the stroke that is visible
    LOG_FILL = 2  # area relative to a rectangle with the predicted sides
