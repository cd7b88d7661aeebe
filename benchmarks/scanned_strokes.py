"""Straighten scanned strokes along their curves, and combine them into one grey picture for `task=train_recovery`.

    python benchmarks/scanned_strokes.py ../shared/real/public/strokes

The folder contains a picture of each stroke's coverage, and ``strokes.json`` with the curves. Scans with a poorly
fitting curve (a bend that one curve cannot follow) are omitted.
"""

import json
import sys
from pathlib import Path

import numpy as np
from brushexp_recovery.curves.bezier import points_on
from brushexp_recovery.synthesis.sheets import BEYOND_ENDS, BEYOND_SIDES
from PIL import Image
from scipy.ndimage import map_coordinates

from brushexp.contracts.strokes import SCAN_COLUMNS, SCAN_ROWS, SCANS

LEAST_FIT = 0.6  # intersection over union of a scan and its curve
POINTS = 400  # per curve


def straighten(cover, curve, width):
    """Sample a stroke's coverage along and across its curve, as an array (SCAN_ROWS, SCAN_COLUMNS)."""
    (points,) = points_on(np.asarray(curve, float)[None], POINTS)
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    way = np.concatenate([[0.0], np.cumsum(steps)])
    ends = BEYOND_ENDS * width
    along = np.linspace(-ends, way[-1] + ends, SCAN_ROWS)
    inner = along.clip(0, way[-1])
    place = np.stack([np.interp(inner, way, points[:, k]) for k in range(2)], 1)
    tangent = np.gradient(points, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    tangent = np.stack([np.interp(inner, way, tangent[:, k]) for k in range(2)], 1)
    place += (along - inner)[:, None] * tangent
    across = np.linspace(-0.5 - BEYOND_SIDES, 0.5 + BEYOND_SIDES, SCAN_COLUMNS) * width
    normal = np.stack([-tangent[:, 1], tangent[:, 0]], 1)
    x, y = (place[:, None] + across[:, None] * normal[:, None]).transpose(2, 0, 1)
    return map_coordinates(cover, [y - 0.5, x - 0.5], order=1, mode="constant")


def main(folder):
    """Write the straightened strokes of a folder to one picture, one below another."""
    sheets = []
    for stroke in json.loads((Path(folder) / "strokes.json").read_text()):
        if stroke["fit_iou"] < LEAST_FIT:
            continue
        cover = np.asarray(Image.open(Path(folder) / stroke["file"]).convert("L"), np.float32)
        sheets.append(straighten(cover, stroke["curve_px"], stroke["width_px"]))
    picture = np.concatenate(sheets).round().clip(0, 255).astype(np.uint8)
    Image.fromarray(picture).save(SCANS, optimize=True)
    print(f"{SCANS}: {len(sheets)} strokes, {SCANS.stat().st_size} bytes")


if __name__ == "__main__":
    main(sys.argv[1])
