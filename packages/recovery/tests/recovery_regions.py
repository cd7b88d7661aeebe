"""Constructed regions for tests of the recovery package."""

import numpy as np
from brushexp_recovery.find.regions import Regions
from brushexp_recovery.model.channels import CENTRE, DIRECTION, LOG_SIZE, OCCLUSION_OFFSETS, StrokeAttribute


def crossed_regions() -> Regions:
    """Make a horizontal region, a vertical one that crosses above it, and a separate one, on 60 x 80 pixels."""
    labels = np.full((60, 80), -1, np.int32)
    labels[24:36, 10:70], labels[5:55, 34:46], labels[50:58, 2:20] = 0, 1, 2
    attributes = np.empty((3, len(StrokeAttribute)))
    attributes[:, CENTRE] = (40, 30), (40, 30), (11, 54)
    attributes[:, DIRECTION] = (1, 0), (-1, 0), (1, 0)
    attributes[:, LOG_SIZE] = np.log([(12, 60), (12, 50), (8, 18)])
    attributes[:, StrokeAttribute.VISIBLE] = 0.8, 1.0, 1.0
    random = np.random.default_rng(0)
    occlusion = random.integers(-30, 30, (len(OCCLUSION_OFFSETS), 60, 80)).astype(np.int8)
    return Regions(labels, np.array([0.9, 0.8, 0.5]), attributes, occlusion, labels >= 0, 1.0)
