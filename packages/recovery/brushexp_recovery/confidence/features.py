"""Compute the region features from which a model predicts whether a region is a stroke."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp_recovery.find.regions import Regions
from brushexp_recovery.model.channels import LOG_SIZE, StrokeAttribute
from brushexp_recovery.model.features import ConfidenceFeature
from brushexp_recovery.raster.labels import count_pixels

Array = NDArray[Any]

DOUBT = 1e-3  # minimum distance of a probability from 0 and 1


def confidence_features(regions: Regions) -> Array:
    """Compute the confidence features (N, len(ConfidenceFeature)) of N regions."""
    chance = np.clip(regions.chance, DOUBT, 1 - DOUBT)
    area = count_pixels(regions.labels, len(chance))
    features = np.empty((len(chance), len(ConfidenceFeature)))
    features[:, ConfidenceFeature.LOG_ODDS] = np.log(chance / (1 - chance))
    features[:, ConfidenceFeature.VISIBLE] = regions.attributes[:, StrokeAttribute.VISIBLE]
    features[:, ConfidenceFeature.LOG_FILL] = np.log(np.maximum(area, 1)) - regions.attributes[:, LOG_SIZE].sum(1)
    return features
