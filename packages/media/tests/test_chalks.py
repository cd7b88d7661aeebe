"""Test that pastels have masses at the bottom, hatching and forms above them, and accents at edges."""

import numpy as np
import pytest
import torch
from brushexp_media.init.accents import APART, DARK, LIGHT, accents
from brushexp_media.marks import RUBBED, VARIANTS, chalk

from brushexp.registry import build_named


def of(init, target, n=300, focus=None, **options):
    return build_named("init", init, options)(target, n, torch.Generator().manual_seed(0), focus)


def bar():
    """Draw a grey picture with a black bar and a white bar."""
    target = torch.full((3, 120, 160), 0.5)
    target[:, 20:100, 40:50] = 0.05
    target[:, 20:100, 110:120] = 0.97
    return target


def thickness(strokes):
    return strokes.width * strokes.scale


def test_masses_are_broad_and_rubbed_and_the_rest_is_drawn_over_them():
    strokes = of("chalks", bar(), accents=0.0)
    rubbed = strokes.brush % VARIANTS >= VARIANTS - RUBBED
    masses = int(rubbed.sum())
    assert 0 < masses < 150
    assert bool(rubbed[:masses].all())
    drawn = thickness(strokes)[masses:][strokes.opacity[masses:] > 0]
    assert float(thickness(strokes)[:masses].min()) > float(drawn.median())


def test_a_face_that_is_drawn_nearer_has_forms_and_accents_alone():
    init = build_named("init", "chalks", {}).nearer()
    strokes = init(bar(), 300, torch.Generator().manual_seed(0))
    assert bool((strokes.brush % VARIANTS < VARIANTS - RUBBED).all())
    assert init.nearer().hatched == 0


def test_a_rubbed_mass_is_soft_and_has_no_grain():
    grain, soft = (chalk(variant)[0] for variant in (0, VARIANTS - 1))
    steps = [float(texture.diff(dim=0).abs().max()) for texture in (grain, soft)]
    assert steps[1] < 0.5 * steps[0]
    assert float(soft.max()) == 1


def test_hatchings_have_the_slant_of_the_hand_and_end_at_edges():
    target = bar()
    strokes = of("chalks", target, accents=0.0, hatched=0.9, calm=0.0)
    count = round(0.9 * 300)
    lines = strokes[len(strokes) - count - 1 : -1]
    lines = lines[lines.opacity > 0]
    along = lines.end - lines.start
    away = (lines.position[:, 0] - 80).abs() > 60  # far from the bars
    assert float((along[:, 0] * along[:, 1] < 0)[away].float().mean()) > 0.7  # lines rise to the right
    ends = [lines.position + part * lines.scale[:, None] / 2 for part in (lines.start, lines.end)]
    left = [(end[:, 0] < 38) & (end[:, 1] - 60).abs().lt(38) for end in ends]
    right = [(end[:, 0] > 52) & (end[:, 0] < 108) & (end[:, 1] - 60).abs().lt(38) for end in ends]
    assert not bool((left[0] & right[1] | left[1] & right[0]).any())


@pytest.mark.parametrize("dark", [True, False])
def test_accents_are_darker_or_lighter_than_what_is_around(dark):
    picture = bar().double().numpy()
    lines = accents(picture, 40, 30.0, 3.0, None, dark=dark, toward=np.zeros(3) if dark else np.ones(3), share=0.5)
    seen = lines[lines.opacity > 0]
    assert len(lines) == 40
    assert len(seen) > 0
    assert bool((seen.color.mean(1) < 0.05 if dark else seen.color.mean(1) > 0.9).all())
    assert bool(((seen.position[:, 0] < 80) == dark).all())


def test_accents_lie_where_one_looks():
    focus = torch.ones(120, 160)
    focus[:, :80], focus[:, 80:] = 0.2, 1.8
    last = of("chalks", bar(), focus=focus, accents=0.3)[-90:]
    seen = last[last.opacity > 0]
    assert len(seen) > 0
    assert bool((seen.position[:, 0] > 80).all())


def test_an_even_picture_has_no_accents():
    even = np.full((3, 60, 80), 0.5)
    even[:, :, 40:] = 0.5 + 0.5 * APART
    assert DARK < 0.5 < LIGHT
    for dark in (True, False):
        lines = accents(even, 20, 20.0, 2.0, None, dark=dark, toward=np.zeros(3), share=0.5)
        assert float(lines.opacity.max()) == 0


def test_rows_differ_in_lightness_alone_when_asked():
    color = of("rows", torch.full((3, 90, 120), 0.5), under=0.0, outlines=0.0, variety=0.0, values=0.1).color[1:]
    assert float((color.amax(1) - color.amin(1)).max()) < 1e-6
    assert float(color.mean(1).std()) == pytest.approx(0.1, abs=0.02)


def test_faint_forms_no_longer_bend_calm_rows_but_do_where_one_looks_first():
    x = np.arange(160) / 160
    faint = torch.from_numpy(np.broadcast_to(0.2 + 0.6 * x, (3, 120, 160)).copy()).float()  # vertical forms
    focus = torch.full((120, 160), 0.5)
    focus[:, 80:] = 16
    options = {"under": 0.0, "outlines": 0.0, "layers": 1, "looseness": 0.0, "turning": 0.0, "edges": 1.0}

    def upright(strokes):
        along = (strokes.end - strokes.start).abs()
        return (along[:, 1] > along[:, 0])[1:]

    loose, calm = (of("rows", faint, 120, **options, calm=c) for c in (1e-2, 3.0))
    assert float(upright(loose).float().mean()) > 0.8
    assert float(upright(calm).float().mean()) < 0.1
    seen = of("rows", faint, 120, focus, **options, calm=3.0)
    x = seen.position[1:, 0]
    assert float(upright(seen)[x > 90].float().mean()) > 0.5
    assert float(upright(seen)[x < 70].float().mean()) < 0.1
