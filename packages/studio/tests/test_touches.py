"""Test that touching up changes only the strokes in the chosen area."""

import numpy as np
import pytest
from PIL import Image
from refusals import refuses

import brushexp

pytest.importorskip("nicegui", reason="the studio is an extra")
from brushexp_studio.touches import TOO_SMALL, Touch, lay_fresh_strokes, overrides_of

pytestmark = pytest.mark.slow
SETTINGS = {"look": "plain", "resolution": 128, "steps": 2, "strokes": 600}
PLACE = slice(20, 70)  # rows and columns of the place
WIDTH = 16  # maximum distance in pixels that strokes reach beyond the place


def test_a_place_gets_finer_looser_or_other_strokes_and_all_else_stays(tmp_path):
    painting = brushexp.paint("coffee", **SETTINGS)
    mask = np.zeros((*painting.image.shape[:2], 3), np.uint8)
    mask[PLACE, PLACE] = 255
    Image.fromarray(mask).save(tmp_path / "mask.png")
    counts = {}
    for how in ("finer", "again", "looser"):
        touch, catalogue = Touch(1, tmp_path / "mask.png", how), tmp_path / f"{how}.h5"
        lay_fresh_strokes(painting, touch, 7, catalogue)
        touched = brushexp.paint("coffee", **overrides_of(SETTINGS, touch, catalogue))
        counts[how] = len(touched.strokes)
        moved = np.abs(touched.image.astype(int) - painting.image).max(2) > 0
        assert moved[PLACE, PLACE].mean() > 0.5
        beside = np.ones_like(moved)
        beside[PLACE.start - WIDTH : PLACE.stop + WIDTH, PLACE.start - WIDTH : PLACE.stop + WIDTH] = False
        assert not moved[beside].any()
    assert counts["looser"] < counts["again"] < counts["finer"]
    mask[PLACE, PLACE] = 0
    mask[30:33, 30:33] = 255
    Image.fromarray(mask).save(tmp_path / "mask.png")
    refuses(TOO_SMALL, lay_fresh_strokes, painting, touch, 7, tmp_path / "small.h5")
