"""Scans of real strokes: acrylic by a flat brush, from full to dry, straightened.

The scans are those of Ardavan Bidgoli (2020, MIT: ``scans/strokes.LICENSE.txt``); ``benchmarks/scanned_strokes.py``
straightens them.
"""

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

SCANS = Path(__file__).parent / "scans" / "strokes.png"  # sheets one below the other
SCAN_ROWS, SCAN_COLUMNS = 160, 64  # of a sheet
SCAN_BEYOND_ENDS, SCAN_BEYOND_SIDES = 0.3, 0.15  # widths that a sheet shows beyond the ends and sides of a stroke


@cache
def read_scans() -> NDArray[Any]:
    """Read the coverage (N, `SCAN_ROWS`, `SCAN_COLUMNS`) uint8 of all scans: rows run along a stroke to its dry end."""
    return np.asarray(Image.open(SCANS)).reshape(-1, SCAN_ROWS, SCAN_COLUMNS)
