"""Test that repainting a region of a painting does not change any pixel outside the region."""

import time

import numpy as np
import pytest
import torch
from brushexp_changes.region.fence import Fence, room_in
from catalogues import job_of
from films import pixels_of
from refusals import refuses
from skimage import io

from brushexp.cli.program import expand_arguments
from brushexp.compositing.layers import SOFT_EDGE
from brushexp.config.check import check
from brushexp.config.compose import compose_config
from brushexp.painting.changes import changed_settings
from brushexp.pictures.load import load_mask
from brushexp.runs.runner import perform
from brushexp.shading.light import Light
from brushexp.strokes.bezier import half_width_of, strokes_along
from brushexp.strokes.catalogue import FIELDS, Strokes
from brushexp.strokes.storage import load_catalogue
from brushexp.tasks import paint

LOOKS = {"plain": "look=plain pixels_per_stroke=40 steps=2", "oil": "look=oil steps=2 light.depth=3"}
QUIET = ["threads=1", "frames=0", "report=false", "logger=[]"]


def perform_in(folder, *words):
    folder.mkdir()
    words = expand_arguments([*words, *QUIET])
    cfg = compose_config(words)
    check(cfg, words)
    perform(paint, cfg, folder, time.monotonic())
    saved = load_catalogue(folder / "catalogue.h5")
    return saved, saved.strokes[saved.depth.argsort()], pixels_of(folder / "painting.png")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Paint a small picture in each look, and save the paintings and some masks in a folder."""
    folder = tmp_path_factory.mktemp("painted")
    mask = np.zeros((64, 96), np.uint8)
    masks = {"empty": mask, "other": mask[:20], "tiny": mask.copy(), "mask": mask.copy()}
    masks["tiny"][30:34, 40:44] = masks["mask"][4:, 8:88] = 255
    for name, pixels in masks.items():
        io.imsave(folder / f"{name}.png", pixels, check_contrast=False)
    for look, words in LOOKS.items():
        perform_in(folder / look, "image=chelsea", "resolution=96", *words.split())
    return folder


@pytest.mark.parametrize("sampler", ["whole", "patches"])
@pytest.mark.parametrize("look", LOOKS)
def test_strokes_inside_the_mask_change_and_every_pixel_outside_stays_to_the_bit(folder, tmp_path, look, sampler):
    region = [f"catalogue={folder / look}", f"region={folder / 'mask.png'}"]
    other = ["image=chelsea", "palette=toned", "palette.chroma=0"]  # another target, of the same shape
    steps = [f"sampler={sampler}", "steps=6", "optimizer.lr=0.6"]  # a rate at which strokes would leave the mask
    before = load_catalogue(folder / look / "catalogue.h5")
    saved, after, pixels = perform_in(tmp_path / "run", *region, *other, *steps)
    strokes, outside = before.strokes[before.depth.argsort()], pixels_of(folder / "mask.png") == 0
    difference = np.abs(pixels - pixels_of(folder / look / "painting.png"))
    assert difference[outside].max() == 0
    assert difference[~outside].mean() > 1
    pairs = {name: (getattr(strokes, name), getattr(after, name)) for name in FIELDS}
    change = {name: (a != b).reshape(len(a), -1).any(1) for name, (a, b) in pairs.items()}
    assert 3 < change["position"].sum() <= change["color"].sum()
    job = job_of(strokes, (64, 96), light=Light(depth=float(look == "oil")))
    inner = Fence(strokes, room_in(torch.from_numpy(~outside), job), SOFT_EDGE).inner
    assert not torch.stack([*change.values()])[:, ~inner].any(), "pixels outside are bit-identical"
    assert torch.equal(saved.background, before.background)


def test_a_painting_of_a_large_photograph_is_repainted_at_the_size_at_which_it_was_optimised(folder, tmp_path):
    before, _, painted = perform_in(tmp_path / "first", "image=chelsea", *LOOKS["oil"].split(), "working_resolution=96")
    region = [f"catalogue={tmp_path / 'first'}", f"region={folder / 'mask.png'}"]
    saved, after, pixels = perform_in(tmp_path / "run", "image=chelsea", *region, "steps=6", "optimizer.lr=0.6")
    assert pixels_of(tmp_path / "run" / "target.png").shape[:2] == (64, 96)
    assert saved.size == before.size == pixels.shape[:2] == (300, 451)
    outside = (load_mask(str(folder / "mask.png"), saved.size, "region") < 0.5).numpy()
    difference = np.abs(pixels - painted)
    assert difference[outside].max() == 0
    assert difference[~outside].mean() > 1
    strokes = before.strokes[before.depth.argsort()]
    change = (strokes.position != after.position).any(1)
    assert 3 < change.sum() < len(strokes)
    assert torch.equal(strokes.scale, after.scale)


@pytest.mark.parametrize(("first", "typed", "side"), [
    ("working_resolution=96", "", "96"),
    ("working_resolution=96", "working_resolution=200", "200"),
    ("working_resolution=96", "working_resolution=null", None),
    ("", "", "451"),  # the whole of a small painting
    ("resolution=96", "", None),
])  # fmt: skip
def test_a_typed_working_resolution_replaces_that_of_the_painting(folder, tmp_path, first, typed, side):
    perform_in(tmp_path / "first", "image=chelsea", "look=plain", "pixels_per_stroke=400", "steps=0", *first.split())
    words = [f"catalogue={tmp_path / 'first'}", f"region={folder / 'mask.png'}", "image=chelsea", *typed.split()]
    words = expand_arguments(words)
    check(cfg := compose_config(words), words)
    assert changed_settings(cfg).working_resolution == side


def test_a_stroke_that_leaves_the_region_returns_to_where_it_was_and_keeps_its_new_color():
    room = torch.zeros(40, 60)
    room[:, 20:] = 50.0
    middles = torch.tensor([[40.0, 20.0], [44.0, 20.0], [10.0, 20.0], [70.0, 20.0]])
    curves = middles[:, None] + torch.tensor([[-4.0, 0], [0, 0], [4.0, 0]])
    strokes = strokes_along(curves, torch.tensor([2.0, 4.0, 3.0, 3.0]), torch.zeros(4, 3), torch.ones(4))
    fence = Fence(strokes, room, SOFT_EDGE)
    assert fence.inner.tolist() == [True, True, False, True], "paint beyond the canvas is invisible"
    moved = strokes.moved(shift=(-25.0, 0)).map(torch.clone)
    moved.color[:], moved.width[:] = 0.5, 2 * strokes.width
    kept = fence(moved, strokes, None)
    assert kept.color[:, 0].tolist() == [0.5, 0.5, 0, 0.5]
    assert torch.equal(kept.position[:3], strokes.position[:3]), "they would leave the region, or were never inside"
    assert torch.equal(kept.position[3], moved.position[3])
    assert half_width_of(kept).median() == half_width_of(strokes).median(), "the light depends on the median width"


@pytest.mark.parametrize(("depth", "tiles"), [(0.0, 7), (1.0, 8)])
def test_paint_keeps_away_from_pixels_that_a_tile_or_the_light_shows_outside(depth, tiles):
    job = job_of(Strokes.none(), (30, 50), light=Light(depth=depth))
    mask = torch.ones(job.size, dtype=torch.bool)
    assert room_in(mask, job).isinf().all()
    mask[:, 0] = False
    assert room_in(mask, job)[5, tiles : tiles + 3].tolist() == [0, 1, 2]


@pytest.mark.parametrize(("words", "message"), [
    ("catalogue=plain change=region", "change=region has no mask; type region=mask.png"),
    ("region=mask.png", "selects a part of a painting; add catalogue=outputs/"),
    ("region=other.png catalogue=plain", "region=.*other.png has 96 x 20 pixels.*same aspect ratio"),
    ("region=empty.png catalogue=plain", "has no bright pixel; paint the area to repaint white"),
    ("region=tiny.png catalogue=plain", "no stroke of .*plain lies wholly inside region=.*; make it larger"),
    ("region=mask.png catalogue=plain image=astronaut", "comes to 96 x 96 pixels, and the painting has 96 x 64; give"),
    ("region=mask.png catalogue=plain painter=haeberli", "region=mask.png is for painter=gradient, not haebe"),
    ("region=mask.png catalogue=plain wet=0.5", "wet=0.5 drags paint out of region=mask.png; drop wet"),
])  # fmt: skip
def test_what_cannot_be_repainted_is_told_with_its_cure(folder, monkeypatch, words, message):
    monkeypatch.chdir(folder)
    image = [] if "image=" in words else ["image=chelsea"]
    words = expand_arguments([*image, *words.split()])
    refuses(message, check, compose_config(words), words)


def test_typed_settings_of_the_painting_itself_are_told_to_stay(folder, monkeypatch, caplog):
    monkeypatch.chdir(folder)
    typed = ["renderer=textured", "strokes=70", "steps=3"]
    words = expand_arguments(["chelsea", "catalogue=plain", "region=mask.png", *typed])
    check(compose_config(words), words)
    assert "change=region sets renderer and strokes itself, so the typed value has no effect" in caplog.text
