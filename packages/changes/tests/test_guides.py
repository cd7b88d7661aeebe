"""Test that strokes near hand-drawn lines follow these lines, and that other strokes stay unchanged."""

import numpy as np
import pytest
import torch
from brushexp_changes.guides.lines import follow, lines_of, load_lines
from refusals import refuses
from skimage import io

from brushexp.registry import build_named
from brushexp.strokes.bezier import curve_of, length_of, point_at
from brushexp.strokes.catalogue import FIELDS
from brushexp.strokes.measures import direction_of
from brushexp.strokes.storage import load_catalogue
from brushexp.tasks import paint

SIZE = (60, 90)
BANDS = (0.5 + 0.5 * torch.sin(torch.arange(90.0) / 4)).expand(3, *SIZE).contiguous()  # vertical bands


def drawn(colors=(0, 0, 0)) -> np.ndarray:
    """Draw a horizontal line on white, in the left half of the picture."""
    picture = np.full((*SIZE, 3), 255, np.uint8)
    picture[29:31, 5:40] = colors
    return picture


def levelness(strokes) -> torch.Tensor:
    return direction_of(curve_of(strokes))[:, 0]  # 1 is horizontal, -1 vertical


@pytest.mark.parametrize("init", ["layers", "slic", "grid"])
def test_strokes_near_a_line_follow_it_and_others_the_picture(init):
    strokes = build_named("init", init, {})(BANDS, 150, torch.Generator().manual_seed(0), None)
    ink = 1 - drawn()[..., 0] / 255.0
    turned = follow(strokes, lines_of(ink))
    x, y = strokes.position.T
    near, far = ((y - 30).abs() < 3) & (x > 8) & (x < 36), (x > 55) | (y < 15)
    assert near.sum() > 3 < far.sum()
    assert levelness(strokes[near]).mean() < -0.5, "the strokes follow the bands"
    assert levelness(turned[near]).min() > 0.8
    for name in FIELDS:
        assert torch.equal(getattr(turned, name)[far], getattr(strokes, name)[far]), name
    lengths = [length_of(curve_of(some[near])) for some in (turned, strokes)]
    torch.testing.assert_close(*lengths, rtol=0.1, atol=0.1)


def test_strokes_bend_with_a_bent_line():
    y, x = np.mgrid[:80, :80]
    ring = (np.abs(np.hypot(y - 40, x - 40) - 20) < 1).astype(float)
    strokes = build_named("init", "layers", {"length": 4.0})(torch.rand(3, 80, 80), 300, torch.Generator(), None)
    curve = curve_of(follow(strokes, lines_of(ring)))
    outward = (curve[:, 1] - 40).norm(dim=1) - (curve[:, [0, 2]].mean(1) - 40).norm(dim=1)
    on_it = ((curve_of(strokes).mean(1) - 40).norm(dim=1) - 20).abs() < 2
    x, y = (point_at(curve, torch.full((300,), 0.5)) - 40).T
    around = torch.stack([y**2 - x**2, -2 * x * y], 1) / (x**2 + y**2)[:, None]  # the ring's direction, doubled
    assert ((direction_of(curve) * around).sum(1)[on_it] > 0.9).all()
    long = on_it & (length_of(curve) > 15)
    assert long.sum() > 3
    assert (outward[long] > 1).all(), "the strokes bulge away from the centre of the ring"


@pytest.mark.parametrize("colors", [(0, 0, 0), (255, 255, 0), (120, 200, 255)])
def test_lines_have_any_color_and_another_size_on_white_or_nothing(tmp_path, colors):
    wide = drawn(colors).repeat(2, 0).repeat(2, 1)
    alpha = 255 * (wide < 255).any(2, keepdims=True).astype(np.uint8)
    io.imsave(tmp_path / "white.png", wide, check_contrast=False)
    io.imsave(tmp_path / "nothing.png", np.dstack([wide * (alpha > 0), alpha]).astype(np.uint8), check_contrast=False)
    for name in ("white.png", "nothing.png"):
        lines = load_lines(str(tmp_path / name), SIZE)
        assert (lines.say[29:31, 5:40] == 1).all()
        assert lines.say[30, 60:].max() < 0.1
        assert lines.doubled[0, 29:31, 8:36].min() > 0.99


def test_a_painting_follows_guides_and_a_picture_without_lines_is_refused(run_task, tmp_path):
    for name, pixels in (("lines", drawn()), ("white", drawn((255, 255, 255))), ("black", 0 * drawn())):
        io.imsave(tmp_path / f"{name}.png", pixels, check_contrast=False)
    io.imsave(tmp_path / "bands.png", (255 * BANDS).byte().permute(1, 2, 0).numpy())
    words = [f"image={tmp_path}/bands.png", "look=oil", "pixels_per_stroke=40", "steps=2", "threads=1", "frames=0"]
    words += ["report=false", "logger=[]"]
    run_task(paint, *words, f"guides={tmp_path}/lines.png")
    strokes = load_catalogue(tmp_path / "catalogue.h5").strokes
    x, y = strokes.position.T
    assert levelness(strokes[((y - 30).abs() < 3) & (x > 8) & (x < 36)]).mean() > 0.7
    assert levelness(strokes[x > 55]).mean() < 0
    for name, message in (("white", "white or transparent all over"), ("black", "no white or transparent ground")):
        refuses(f"guides=.*{name}.png .*{message}", run_task, paint, *words, f"guides={tmp_path}/{name}.png")
    refuses(r"change=guides has no lines; type guides=lines\.png", run_task, paint, *words, "change=guides")
    guides = f"guides={tmp_path}/lines.png"
    refuses(f"{guides} is for painter=gradient, not zou", run_task, paint, *words, guides, "painter=zou")
