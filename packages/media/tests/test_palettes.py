"""Test that palettes give a picture a medium's colours, and that losses for dots reward pure hues and correct means."""

from pathlib import Path

import brushexp_media
import numpy as np
import pytest
import torch
from brushexp_media.blurred import Blurred
from brushexp_media.chroma import Chroma
from brushexp_media.palettes import (
    CLEAR,
    LAMPLIGHT,
    NIGHT,
    STEEPEST,
    compress_chroma,
    equalise_tones,
    group_tones,
    harmonise,
    share_of_dark,
    share_of_night,
)
from brushexp_media.picture.decolorization import contrast_weights, decolorize
from brushexp_media.picture.smoothing import gaussian_blur
from omegaconf import OmegaConf
from scipy.ndimage import gaussian_filter
from torch.testing import assert_close

from brushexp.errors import UserError
from brushexp.pictures.color import as_lab, as_picture
from brushexp.plugins.loss.base import PaintedView
from brushexp.registry import build_named
from brushexp.strokes.catalogue import Strokes


def test_a_blurred_loss_is_blind_to_dots_and_sees_their_mean():
    target = torch.full((3, 32, 40), 0.5)
    dots = target + 0.4 * (-1.0) ** (torch.arange(32)[:, None] + torch.arange(40))
    seen = [float(Blurred(sigma=2)(PaintedView(image, target, Strokes.none()))) for image in (dots, target + 0.1)]
    assert seen[0] < 1e-3
    assert seen[1] == pytest.approx(0.01, rel=0.01)


def test_blur_agrees_with_scipy():
    picture = torch.rand(2, 15, 21, dtype=torch.float64)
    blurred = np.stack([gaussian_filter(one, 1.7, mode="nearest", radius=6) for one in picture.numpy()])
    assert_close(gaussian_blur(picture, 1.7), torch.from_numpy(blurred))


def test_chroma_asks_for_pure_colours_alone():
    color = torch.tensor([[0.5, 0.5, 0.5], [0.9, 0.1, 0.3]], requires_grad=True)
    strokes = Strokes(*(torch.zeros(2, *shape) for shape in ((2,), (), (2,), (2,), (2,), ())), color, torch.ones(2))
    value = Chroma(least=0.5)(PaintedView(torch.zeros(3, 2, 2), torch.zeros(3, 2, 2), strokes))
    assert float(value.detach()) == pytest.approx(0.125)


def test_values_are_grouped():
    groups = group_tones(np.linspace(0, 100, 1001), 4, 1.0)
    assert np.unique(groups.round(6)).tolist() == [12.5, 37.5, 62.5, 87.5]
    assert np.array_equal(group_tones(np.linspace(0, 100, 11), 0, 1.0), np.linspace(0, 100, 11))


@pytest.mark.parametrize("look", ["impasto", "gouache", "watercolour", "pastel", "vangogh", "pointillist", "ink"])
def test_darks_of_a_night_stay_dark_and_its_lit_places_are_as_light_as_by_day(look):
    conf = OmegaConf.load(Path(brushexp_media.__file__).parent / "conf" / "look" / f"{look}.yaml")
    options = OmegaConf.to_container(conf, resolve=True)["palette"]
    toned = build_named("palette", "one_ink" if look == "ink" else "toned", options)
    night = 0.25 * torch.rand(3, 40, 60, generator=torch.Generator().manual_seed(0))
    night[:, 5:9, 20:40] = 0.9  # a lit window
    lab, own = as_lab(toned(night))[..., 0], as_lab(night)[..., 0]
    dark = own < LAMPLIGHT[0]
    assert own.mean() < NIGHT
    assert lab[dark].mean() - own[dark].mean() < 14
    assert lab[6, 30] > 88
    assert share_of_night(50.0, 62.0) == 0
    assert share_of_night(20.0, 19.0) == 0
    kept = share_of_dark(np.array([0.0, LAMPLIGHT[0], sum(LAMPLIGHT) / 2, LAMPLIGHT[1], 100.0]))
    assert np.allclose(kept, [1, 1, 0.5, 0, 0])


def test_washes_of_one_ink_have_the_tones_of_a_grey_palette_and_hues_that_only_deepen():
    picture = torch.rand(3, 30, 40, generator=torch.Generator().manual_seed(0))
    picture[:, :4], picture[:, 4:8] = 0.0, 1.0
    options = {"dark": 20.0, "light": 94.0, "night": 0.0}
    ink = build_named("palette", "one_ink", {"paper": "#f6efe0", "wash": "#d8c7aa", **options})
    assert not ink.has_hues
    washes = ink(picture)
    grey = torch.from_numpy(decolorize(picture.numpy(), contrast_weights(picture.numpy()))).expand(3, -1, -1)
    toned = as_lab(build_named("palette", "toned", {"chroma": 0.0, **options})(grey.float().contiguous()))[..., 0]
    assert_close(as_lab(washes)[..., 0], toned, atol=0.1, rtol=0)
    red, green, blue = washes
    assert bool(((red >= green) & (green >= blue)).all())
    assert_close(washes[:, 5, 0], torch.tensor([0xF6, 0xEF, 0xE0]) / 255, atol=0.02, rtol=0)
    density = -(washes.clamp_min(1e-3) / (torch.tensor([0xF6, 0xEF, 0xE0]) / 255)[:, None, None]).log()
    shares = density[:, density.sum(0) > 0.5]
    shares = shares / shares.sum(0)
    assert_close(shares, shares[:, :1].expand_as(shares), atol=1e-3, rtol=0)


@pytest.mark.parametrize("paper", ["mean", "transparent", "black", "white"])
def test_any_ground_is_a_paper_for_washes(paper):
    picture = torch.rand(3, 12, 16)
    washes = build_named("palette", "one_ink", {"paper": paper})(picture)
    assert washes.isfinite().all()
    assert float(washes.min()) >= 0
    white = build_named("palette", "one_ink", {"paper": "white"})(picture)
    assert torch.equal(washes, white) == (paper != "black")


@pytest.mark.parametrize("option", ["palette.one_ink.wash", "init.drawing.color", "init.rows.outline"])
def test_no_ink_has_the_colour_of_the_picture(option):
    family, name, key = option.split(".")
    with pytest.raises(UserError, match=r"=mean is not the colour of an ink; try .*=sienna"):
        build_named(family, name, {key: "mean"})


def test_a_palette_lifts_lights_to_white_and_keeps_black_from_it():
    ramp = torch.linspace(0, 1, 100).expand(3, 4, 100).contiguous()
    lab = as_lab(build_named("palette", "toned", {"white": 80, "dark": 20})(ramp))
    assert lab[..., 0].min() == pytest.approx(20, abs=0.5)
    assert (lab[..., 0] > 99).mean() == pytest.approx((as_lab(ramp)[..., 0] > 80).mean(), abs=0.02)


def test_the_colours_of_another_picture_have_its_mean():
    picture = torch.rand(3, 20, 30) * 0.3
    palette = build_named("palette", "picture", {"image": "coffee"})
    warm = palette(picture).mean((1, 2))
    assert warm[0] > warm[2] + 0.1


def test_tones_go_apart_until_all_are_as_frequent():
    lightness = np.random.default_rng(0).normal(50, 18, (80, 90)).clip(0, 100)
    assert np.array_equal(equalise_tones(lightness, 0.0), lightness)
    half, whole = (equalise_tones(lightness, share) for share in (0.5, 1.0))
    assert lightness.std() < half.std() < whole.std()
    assert whole.std() == pytest.approx(100 / np.sqrt(12), rel=0.1)
    order = lightness.argsort(None)
    assert (np.diff(whole.ravel()[order]) >= 0).all()


def test_even_pictures_stay_even_when_tones_go_apart():
    lightness = 60 + 2 * np.random.default_rng(0).random((40, 50))
    assert np.ptp(equalise_tones(lightness, 1.0)) < (STEEPEST + 1) * np.ptp(lightness)


def test_light_things_beside_dark_ones_become_lighter():
    picture = torch.full((3, 60, 200), 0.4)
    picture[:, :, 100:] = 0.6
    plain, more = (as_lab(build_named("palette", "toned", {"irradiation": by})(picture))[30, :, 0] for by in (0.0, 0.5))
    change = more - plain
    assert change[101] > 3
    assert change[98] < -3
    assert np.abs(change[[20, 180]]).max() < 0.1


def test_white_keeps_clear_colours():
    lab = np.broadcast_to(np.array([[88.0, 0.0, 8.0], [88.0, 0.0, 1.2 * CLEAR]])[:, None], (2, 40, 3))
    seen = as_lab(build_named("palette", "toned", {"white": 85})(as_picture(lab)))
    assert np.hypot(*seen[0, 0, 1:]) < 3
    assert np.hypot(*seen[1, 0, 1:]) > 0.4 * CLEAR


def test_chroma_stays_below_its_limit_and_half_of_that_stays():
    chroma = np.linspace(0, 200, 401)
    bent = compress_chroma(chroma, np.full(401, 60.0))
    assert np.array_equal(bent[chroma <= 30], chroma[chroma <= 30])
    assert (np.diff(bent) > 0).all()
    assert 55 < bent.max() < 60


def test_the_lightest_colours_have_less_chroma_than_others_but_for_yellow():
    lab = np.broadcast_to(np.array([[50.0, 50.0, 0.0], [90.0, -40.0, 0.0], [85.0, 0.0, 50.0]])[:, None], (3, 40, 3))
    seen = as_lab(build_named("palette", "toned", {"most_chroma": 70})(as_picture(lab)))
    red, pale, yellow = np.hypot(*seen[:, 0, 1:].T)
    assert red > 44
    assert pale < 35
    assert yellow > 45


def test_hues_are_drawn_towards_the_few_of_the_picture_and_keep_their_chroma():
    random = np.random.default_rng(0)
    middle = np.array([[30.0, 0.0], [-15.0, 26.0]])[random.integers(2, size=(40, 50))]
    ab = middle + random.normal(0, 5, (40, 50, 2))
    ab[7, 9] = middle[7, 9] = accent = 2.0, -40.0
    drawn = harmonise(ab, 2, 0.5)
    off = [np.abs(np.angle(each.view(complex) / middle.view(complex))).mean() for each in (ab, drawn)]
    assert 0.45 < off[1] / off[0] < 0.7
    assert np.allclose(drawn[7, 9], accent, atol=1)  # far from both colours
    assert np.allclose(np.hypot(*drawn.T), np.hypot(*ab.T))


@pytest.mark.parametrize("chroma", [1.0, 1.5])
def test_a_green_tint_of_white_is_not_raised_and_a_warm_one_and_a_dark_green_are(chroma):
    lab = np.array([[[90.0, -5.0, 2.0], [40.0, -5.0, 2.0], [90.0, 5.0, 2.0]]])
    toned = as_lab(build_named("palette", "toned", {"least_chroma": 20.0, "chroma": chroma})(as_picture(lab)))
    assert np.hypot(*toned[0, 0, 1:]) < 2 * np.hypot(5, 2)
    assert (np.hypot(*toned[0, 1:, 1:].T) > 1.8 * np.hypot(5, 2)).all()


def test_greys_have_no_hues_to_be_drawn_towards():
    grey = np.zeros((4, 5, 2))
    assert np.array_equal(harmonise(grey, 3, 1.0), grey)
