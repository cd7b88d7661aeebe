"""Test that several changes all take effect in the same painting."""

import numpy as np
import pytest
import torch
from brushexp_changes.tubes.mixtures import all_mixtures
from brushexp_changes.tubes.paints import load_tubes
from films import pixels_of
from refusals import refuses
from skimage import io
from test_guides import BANDS, SIZE, drawn, levelness

import brushexp
from brushexp.config.check import check
from brushexp.strokes.catalogue import FIELDS
from brushexp.strokes.storage import load_catalogue

QUIET = {"look": "oil", "pixels_per_stroke": 40, "light": {"depth": 0}, "threads": 1}
RIGHT = 60  # first column outside the region
REPAINTED = {"steps": 12, "density": "fixed", "focus": None}


@pytest.fixture(scope="module")
def painted(tmp_path_factory):
    """Write a painting of vertical bands, a picture of a horizontal line, and a mask to a folder."""
    folder = tmp_path_factory.mktemp("painted")
    mask = np.zeros(SIZE, np.uint8)
    mask[:, :RIGHT] = 255
    io.imsave(folder / "bands.png", (255 * BANDS).byte().permute(1, 2, 0).numpy())
    io.imsave(folder / "lines.png", drawn(), check_contrast=False)
    io.imsave(folder / "mask.png", mask, check_contrast=False)
    brushexp.paint(str(folder / "bands.png"), **QUIET, steps=2).save(folder / "run")
    return folder


def laid(saved):
    return saved.strokes[saved.depth.argsort()]


def test_guides_region_and_tubes_paint_one_painting(painted, tmp_path):
    before = load_catalogue(painted / "run" / "catalogue.h5")
    brushexp.paint(
        str(painted / "bands.png"),
        catalogue=str(painted / "run"),
        guides=painted / "lines.png",
        region=painted / "mask.png",
        tubes="zorn",
        mixtures=5,
        brushes=[25, 12],
        **QUIET | REPAINTED,
    ).save(tmp_path / "run")
    after = load_catalogue(tmp_path / "run" / "catalogue.h5")

    was, now = (pixels_of(folder / "run" / "painting.png") for folder in (painted, tmp_path))
    assert np.abs(was - now)[:, RIGHT:].max() == 0, "pixels outside the region are bit-identical"
    assert np.abs(was - now)[:, :RIGHT].mean() > 1

    strokes, first = laid(after), laid(before)
    changed = (strokes.color != first.color).any(1)
    assert 20 < changed.sum() < len(strokes)
    for name in FIELDS:
        same = (getattr(strokes, name) == getattr(first, name)).reshape(len(strokes), -1).all(1)
        assert same[~changed].all(), name
    colors = strokes.color[changed]
    mixtures = all_mixtures(load_tubes("zorn")).color.double()
    assert torch.cdist(colors.double(), mixtures).amin(1).max() < 1e-6
    assert len(torch.unique(colors, dim=0)) <= 5, "strokes in the region have the colours of mixtures"

    x, y = strokes.position.T
    near = changed & ((y - 30).abs() < 3) & (x > 8) & (x < 36)
    assert near.sum() > 3
    assert levelness(first[near]).mean() < -0.5, "the strokes followed the bands"
    assert levelness(strokes[near]).mean() > 0.7, "the strokes now follow the line"


def test_each_change_has_its_say_where_others_have_one_too(painted):
    small = {"image": str(painted / "bands.png"), **QUIET, "steps": 4, "seed": 1}
    plain = brushexp.paint(**small)
    wet = brushexp.paint(**small, wet=0.7, smallest=3)
    assert len(wet.strokes) > len(plain.strokes), "wet paint is dragged in films"
    painting = brushexp.paint(**small, guides=painted / "lines.png", smallest=3, largest=6, variety=0)
    x, y = painting.strokes.position.T
    assert levelness(painting.strokes[((y - 30).abs() < 3) & (x > 8) & (x < 36)]).mean() > 0.7
    width = painting.strokes.width * painting.strokes.scale
    assert 3 - 1e-3 < width.min() <= width.max() < 6 + 1e-3


def test_what_excludes_each_other_is_refused_in_words(config, painted, monkeypatch):
    monkeypatch.chdir(painted)
    for words, message in (
        (["tubes=zorn", "wet=0.5"], "wet=0.5 drags colours that no mixture has; drop wet, or drop tubes"),
        (["region=mask.png", "catalogue=run", "wet=0.5"], "wet=0.5 drags paint out of region=mask.png; drop wet"),
    ):
        refuses(message, check, config("bands.png", *words), words)
