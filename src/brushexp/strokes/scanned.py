"""Read straightened scans of real acrylic strokes, each painted with a flat brush until it ran dry.

The scans are by Ardavan Bidgoli (2020, MIT licence: ``scans/strokes.LICENSE.txt``) and were straightened by
``benchmarks/scanned_strokes.py``.
"""

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

SCANS = Path(__file__).parent / "scans" / "strokes.png"  # all sheets in a single picture, top to bottom
SCAN_ROWS, SCAN_COLUMNS = 160, 64  # pixels of a sheet along and across the stroke
SCAN_BEYOND_ENDS, SCAN_BEYOND_SIDES = 0.3, 0.15  # margin beyond the ends and sides of a stroke, in its widths


@cache
def read_scans() -> NDArray[Any]:
    """Return the coverage (N, `SCAN_ROWS`, `SCAN_COLUMNS`) uint8 of all scans; rows run towards the dry end."""
    return np.asarray(Image.open(SCANS)).reshape(-1, SCAN_ROWS, SCAN_COLUMNS)
