"""Test that paints mix like real paints, and that pictures contain only colours that can be mixed."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from brushexp_changes.tubes.mixtures import all_mixtures, choose_mixtures, differences, map_tones
from brushexp_changes.tubes.paints import SETS, load_tubes, srgb_of_reflectance
from refusals import refuses

from brushexp.pictures.color import to_lab
from brushexp.registry import build_named

EIGHT = load_tubes("eight")


@pytest.mark.parametrize("name", SETS)
def test_mixtures_do_not_depend_on_how_much_is_mixed_and_stay_between_their_tubes(name):
    tubes = load_tubes(name)
    parts = np.random.default_rng(0).integers(0, 5, (50, len(tubes))) + np.eye(len(tubes), dtype=int)[[0] * 50]
    mixed = tubes.mix(parts)
    np.testing.assert_allclose(tubes.mix(3 * parts), mixed, atol=1e-12)
    assert (mixed >= 0).all()
    assert (mixed <= 1).all()
    pure = to_lab(tubes.mix(np.eye(len(tubes))))[:, 0]
    lightness = to_lab(mixed)[:, 0]
    assert (lightness >= pure.min() - 0.5).all()
    assert (lightness <= pure.max() + 0.5).all()


def test_paints_make_what_painters_know_white_is_white_and_every_mixture_is_listed_once():
    def mix(**parts: int) -> np.ndarray:
        names = [name.replace(" ", "_") for name in EIGHT.names]
        return EIGHT.mix(np.array([[parts.get(name, 0) for name in names]]))[0]

    red, green, blue = mix(hansa_yellow_opaque=1, phthalo_green_blue_shade=1)
    assert green > red > blue or green > blue > red
    grey = to_lab(mix(titanium_white=4, bone_black=1)[None])[0]
    assert np.hypot(*grey[1:]) < 5
    tint = to_lab(np.stack([mix(ultramarine_blue=1), mix(ultramarine_blue=1, titanium_white=8)]))
    assert tint[1, 0] > tint[0, 0] + 30
    np.testing.assert_allclose(srgb_of_reflectance(np.array([[1.0] * 16, [0.0] * 16])), [[1] * 3, [0] * 3], atol=1e-6)
    mixtures = all_mixtures(load_tubes("zorn"))
    shares = mixtures.parts / mixtures.parts.sum(1, keepdims=True)
    assert len(np.unique(shares.round(9), axis=0)) == len(mixtures)
    assert ((mixtures.parts > 0).sum(1) <= 3).all()
    assert mixtures.recipe(0) == "titanium white"
    assert len(all_mixtures(replace_names(1))) == 1


def test_a_file_of_reflectances_and_one_of_colours_are_read(tmp_path):
    waves = range(400, 701, 20)
    flat = tmp_path / "flat.csv"
    flat.write_text("tube," + ",".join(f"R{w}" for w in waves) + "\ngrey," + ",".join(["0.2"] * 16) + "\n")
    (grey,) = load_tubes(str(flat)).mix(np.ones((1, 1)))
    assert grey == pytest.approx([srgb_of_reflectance(np.full((1, 16), 0.2))[0, 0]] * 3, abs=1e-6)
    for between in ";\t":  # separators of spreadsheets where the decimal mark is a comma
        text = flat.read_text().replace(",", between).replace("0.2", "0,2")
        (tmp_path / "theirs.csv").write_text(text)
        assert load_tubes(str(tmp_path / "theirs.csv")).mix(np.ones((1, 1)))[0] == pytest.approx(grey)
    colors = tmp_path / "colors.csv"
    colors.write_text("tube,color\nwhite,#ffffff\nblue,#1a4fc0\n")
    pure = load_tubes(str(colors)).mix(np.eye(2))
    np.testing.assert_allclose(pure, [[1, 1, 1], [0x1A / 255, 0x4F / 255, 0xC0 / 255]], atol=2e-3)


SPECTRUM = "tube," + ",".join(f"R{wave}" for wave in range(400, 701, 20)) + "\n"


@pytest.mark.parametrize(("text", "message"), [
    ("name,color\na,red\n", "a name in the column tube"),
    ("tube,color\n", "give 1 to 24 tubes"),
    ("tube,color\nwhite,#fff\na,reddish\n", "tube a: reddish is not a colour; write it as #c8a040"),
    ("tube,color\nwhite,#fff\nb\n", "tube b: nothing is not a colour"),
    ("tube,color\nred,#f00\nblue,#00f\nRed ,#e00\n", "has two tubes named red; rename one"),
    (SPECTRUM + "a" + ",0.5" * 16 + "\nb" + ",0.5" * 15 + "\n", "tube b: R700 is empty, not a number; correct it"),
    (SPECTRUM + "a,x" + ",0.5" * 15 + "\n", "tube a: R400 is x, not a number"),
    (SPECTRUM + "a" + ",0.5" * 15 + ",nan\n", "tube a: R700 is nan, not a number"),
    (SPECTRUM + "a" + ",0.5" * 15 + ",50\n", "tube a: a reflectance must be above 0 and at most 1"),
    ("tube,R400\na,0.5\n", "R700 in steps of 20"),
    ("tube,size\na,0.5\n", "cannot be read"),
])  # fmt: skip
def test_files_that_are_no_tubes_are_refused_in_words(tmp_path, text, message):
    (tmp_path / "own.csv").write_text(text)
    refuses(message, load_tubes, str(tmp_path / "own.csv"))


def replace_names(count: int):
    return replace(
        EIGHT, names=EIGHT.names[:count], mix=lambda parts: EIGHT.mix(np.pad(parts, ((0, 0), (0, 8 - count))))
    )


def test_chosen_mixtures_are_as_good_as_any_pair_more_are_nearer_and_tones_lie_between_those_of_the_paints():
    few = all_mixtures(load_tubes("zorn"))[np.arange(0, 200, 9)]
    picture = few.color[[2, 7]].T.reshape(3, 1, 2).repeat(1, 4, 3)
    chosen = choose_mixtures(few, picture, 2)
    torch.testing.assert_close(chosen.color.sort(0)[0], few.color[[2, 7]].sort(0)[0])
    one = choose_mixtures(few, picture, 1)
    every = differences(picture.flatten(1).T.double().numpy(), few.color.double().numpy()).mean(0)
    mine = differences(picture.flatten(1).T.double().numpy(), one.color.double().numpy()).mean()
    assert mine == pytest.approx(every.min(), abs=0.2)
    picture = torch.rand(3, 20, 20, generator=torch.Generator().manual_seed(1))
    colors = picture.flatten(1).T.double().numpy()
    near = []
    for count in (1, 4, 16):
        chosen = choose_mixtures(all_mixtures(EIGHT), picture, count)
        assert 1 <= len(chosen) <= count
        near.append(differences(colors, chosen.color.double().numpy()).min(1).mean())
    assert near == sorted(near, reverse=True)
    mixtures = all_mixtures(EIGHT)
    picture = torch.tensor([0.0, 0.5, 1.0]).expand(3, 1, 3)
    lightness = to_lab(map_tones(picture, mixtures).flatten(1).T.double().numpy())[:, 0]
    of_paints = to_lab(EIGHT.mix(np.eye(8)))[:2, 0]  # white and black
    assert lightness[[0, 2]] == pytest.approx([of_paints[1], of_paints[0]], abs=1.5)
    assert lightness[0] < lightness[1] < lightness[2]


@pytest.mark.parametrize("tubes", ["zorn", "primaries"])
def test_a_palette_of_pigments_has_colours_that_can_be_mixed(tubes):
    picture = torch.rand(3, 20, 30, generator=torch.Generator().manual_seed(0))
    picture[:, 0, 0] = torch.tensor([0.1, 0.2, 0.9])
    painted = build_named("palette", "pigments", {"tubes": tubes})(picture)
    assert painted.shape == picture.shape
    colors = painted.flatten(1).T.double().numpy()
    assert 0 <= colors.min() <= colors.max() <= 1
    mixtures = all_mixtures(load_tubes(tubes)).color.double().numpy()
    assert np.median(differences(colors, mixtures).min(1)) < 2
    assert (to_lab(colors[:1])[0, 2] < -25) == (tubes == "primaries"), "Zorn's palette has black instead of blue"


CANVAS = (60, 90)
