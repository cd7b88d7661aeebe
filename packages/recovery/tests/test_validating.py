"""Regions joined by affinities are counted against the known strokes while the network learns."""

import numpy as np
import torch
from brushexp_recovery.network import AFFINE, CHANNELS, OFFSETS, PAINT
from brushexp_recovery.synthesis_crops import Crops
from brushexp_recovery.validating import Counts, counts_of

SURE = 6.0  # log-odds


def told_of(labels):
    """Maps of a network that knows every affinity and where paint is."""
    told = torch.zeros(1, CHANNELS, *labels.shape)
    for channel, (dy, dx) in enumerate(OFFSETS):
        there = np.roll(labels, (-dy, -dx), (0, 1))
        told[0, channel] = torch.from_numpy(np.where(labels == there, SURE, -SURE))
    told[0, AFFINE + PAINT] = torch.from_numpy(np.where(labels >= 0, SURE, -SURE))
    return told


def crops_of(labels):
    return Crops(torch.zeros(1, 3, *labels.shape), torch.from_numpy(labels)[None], torch.zeros(1, 7, *labels.shape))


def bars():
    labels = np.full((64, 64), -1)
    labels[4:20, 4:60], labels[30:44, 4:30], labels[30:44, 30:60] = 0, 1, 2
    return labels


def test_a_network_that_knows_all_finds_all():
    assert counts_of(told_of(bars()), crops_of(bars())) == Counts(3, 3, 3)


def test_strokes_that_the_network_takes_for_one_are_lost():
    joined = np.where(bars() == 2, 1, bars())
    counts = counts_of(told_of(joined), crops_of(bars()))
    assert counts.found == 2
    assert counts.known == 3
    assert counts.f1 < 1
