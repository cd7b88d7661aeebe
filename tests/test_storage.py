"""Tests that a catalogue keeps strokes in range, reads back unchanged, and is refused with a reason if damaged."""

import math
import re
from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import h5py
import numpy as np
import pytest
import torch
from catalogues import CONFIG, assert_same, catalogue, give_attribute, refused, refused_if_foreign, spoil_every
from refusals import refuses
from scenes import random_strokes

from brushexp.strokes.catalogue import FIELDS, LATER_FIELDS, Catalogue, check_strokes
from brushexp.strokes.saved import alpha_of, json_lines, parse, png_of
from brushexp.strokes.storage import load_catalogue, save_catalogue


@pytest.fixture
def stored(tmp_path):
    save_catalogue(tmp_path / "catalogue.h5", catalogue())
    return tmp_path / "catalogue.h5"


@pytest.mark.parametrize("count", [0, 1, 7, 3000])
def test_a_catalogue_comes_back_as_it_was_and_is_always_stored_in_the_same_bytes(tmp_path, count):
    saved = replace(catalogue(count), config="".join(f"key_{i}: {'x' * 100}\n" for i in range(count)) or CONFIG)
    for name in ("a.h5", "b.h5"):
        save_catalogue(tmp_path / name, saved)
    assert_same(load_catalogue(tmp_path / "a.h5"), saved)
    assert (tmp_path / "a.h5").read_bytes() == (tmp_path / "b.h5").read_bytes()


def test_parameters_are_stored_as_numbers_and_the_file_says_what_it_holds(tmp_path, stored):
    saved = catalogue()
    strokes = saved.strokes.map(lambda value: value.double().requires_grad_())
    save_catalogue(tmp_path / "a.h5", replace(saved, strokes=strokes, depth=saved.depth.long()))
    read = load_catalogue(tmp_path / "a.h5")
    torch.testing.assert_close(read.strokes.color, saved.strokes.color, rtol=0, atol=0)
    assert not read.strokes.color.requires_grad
    with h5py.File(stored) as file:
        assert set(file) == {*FIELDS, "brush", "depth"}
        assert (file.attrs["format"], file.attrs["format_version"]) == (b"brushexp catalogue", 4)
        for name, field in FIELDS.items():
            assert file[name].dtype == np.float32
            assert file[name].attrs["unit"].decode() == field.unit
        assert file["depth"].dtype == file["brush"].dtype == np.int32


@pytest.mark.parametrize(("version", "missing"), [(2, tuple(LATER_FIELDS)), (3, ("drift",))])
def test_a_file_without_later_fields_is_one_of_before_them(version, missing, tmp_path):
    saved = catalogue()
    shapes = {name: torch.zeros(FIELDS[name].shape(len(saved.strokes))) for name in missing}
    saved = replace(saved, strokes=replace(saved.strokes, **shapes))
    save_catalogue(tmp_path / "a.h5", saved)
    with h5py.File(tmp_path / "a.h5") as file:
        assert set(file) == {*FIELDS, "brush", "depth"} - set(missing)
        assert file.attrs["format_version"] == version
    text = "".join(json_lines(saved))
    assert f'"format_version": {version}' in text
    assert not any(f'"{name}"' in text for name in missing)
    for read in (load_catalogue(tmp_path / "a.h5"), parse(text)):
        assert_same(read, saved)


def test_strokes_keep_their_brushes_in_files_and_the_config_is_text_and_runs_nothing(tmp_path, stored):
    saved, brushes = catalogue(3), [5, 0, 2**31 - 1]
    save_catalogue(tmp_path / "a.h5", replace(saved, strokes=replace(saved.strokes, brush=torch.tensor(brushes))))
    assert load_catalogue(tmp_path / "a.h5").strokes.brush.tolist() == brushes
    with h5py.File(stored, "a") as file:
        del file["brush"]
    assert load_catalogue(stored).strokes.brush.tolist() == list(range(len(catalogue().strokes)))
    mark = tmp_path / "mark"
    config = f"a: !!python/object/apply:os.mkdir ['{mark}']\n_target_: os.mkdir\npath: {mark}\n"
    save_catalogue(tmp_path / "a.h5", replace(catalogue(), config=config))
    assert load_catalogue(tmp_path / "a.h5").config == config
    assert not mark.exists()


@pytest.mark.parametrize(("change", "message"), [
    ({"size": (0, 5)}, "the canvas is 0 x 5"),
    ({"depth": torch.zeros(7).int()}, "depth is not an order"),
    ({"background": torch.tensor([0.0, 2.0, 0.0])}, "background is"),
    ({"config": "a: [1"}, "config is not YAML"),
    ({"strokes": replace(catalogue().strokes, width=torch.full((7,), torch.nan))}, "stroke 0: width is nan"),
])  # fmt: skip
def test_what_could_not_be_read_again_is_not_written(tmp_path, change, message):
    refuses(message, save_catalogue, tmp_path / "a.h5", replace(catalogue(), **change))
    assert not list(tmp_path.iterdir())


def test_alpha_comes_back_and_what_is_no_picture_of_it_is_explained(tmp_path):
    alpha = torch.arange(12, dtype=torch.uint8).reshape(3, 4) * 20
    saved = replace(catalogue(), alpha=alpha)
    save_catalogue(tmp_path / "it.h5", saved)
    assert torch.equal(load_catalogue(tmp_path / "it.h5").alpha, alpha)
    text = "".join(json_lines(saved))
    assert torch.equal(parse(text).alpha, alpha)
    packed = png_of(alpha)
    for wrong in (b"", b"no picture", packed[:40], packed[:20] + bytes(20) + packed[40:]):
        refuses("alpha is not a readable PNG", alpha_of, wrong)
    for wrong in ('"?"', "3"):
        refuses("alpha is", parse, re.sub('"alpha": "[^"]*"', f'"alpha": {wrong}', text))


def test_a_path_to_no_catalogue_is_explained(tmp_path):
    assert "there is no file" in refused(tmp_path / "a.h5")
    assert f"there is no file {tmp_path / 'catalogue.h5'}" in refused(tmp_path), "a folder stands for its catalogue"
    assert "not a brushexp catalogue" in refused_if_foreign(tmp_path / "a.h5", refused)


def test_an_unreadable_file_is_explained(stored, monkeypatch):
    monkeypatch.setattr(Path, "open", Mock(side_effect=PermissionError(13, "Permission denied")))
    assert "Permission denied" in refused(stored)


@pytest.mark.timeout(60)
def test_no_wrong_byte_goes_unnoticed_nor_that_some_are_missing(stored):
    data, saved = stored.read_bytes(), load_catalogue(stored)
    spoil_every(stored, 67, lambda: assert_same(load_catalogue(stored), saved))
    for share in (0.1, 0.3, 0.5, 0.9, 0.999):
        stored.write_bytes(data[: int(len(data) * share)])
        assert "is damaged or cut short" in refused(stored)


@pytest.mark.parametrize(("name", "value", "message"), [
    ("format", "brushexp strokes", "not a brushexp catalogue"),
    ("format", 3, "attribute format is"),
    ("format_version", 5, "has format_version 5, and this brushexp reads 4; update brushexp"),
    ("format_version", "1", "attribute format_version is '1'; a whole number is needed"),
    ("height", 0, "the canvas is 0 x 50 pixels"),
    ("width", 2_000_000, "the canvas is 30 x 2000000 pixels"),
    ("width", 3.5, "attribute width is .*; a whole number is needed"),
    ("background", [0.1, 0.2], "background is"),
    ("background", "white", "attribute background is .*, not numbers; "),
    ("renderer_hash", np.zeros(3), "attribute renderer_hash is .*; text is needed"),
    ("config", 5, "attribute config is .*; text is needed"),
    ("config", "a: [1, 2", "config is not YAML"),
    ("config", "just words", "config is not a YAML mapping"),
    *((name, None, f"has no attribute {name}") for name in ("format_version", "height", "background", "renderer")),
])  # fmt: skip
def test_a_wrong_or_missing_attribute_is_explained(stored, name, value, message):
    give_attribute(stored, name, value)
    assert re.search(message, refused(stored))


@pytest.mark.parametrize(("name", "data", "message"), [
    ("position", np.zeros((7, 3), np.float32), r"position has shape \(7, 3\); \(7, 2\) is needed"),
    ("opacity", np.float32(1), r"opacity has shape \(\); \(7,\) is needed"),
    ("color", np.zeros((7, 3), np.float64), "color has type float64; float32 is needed"),
    ("start", np.full((7, 2), b"x"), r"start has type \|S1; float32 is needed"),
    ("depth", np.arange(7), "depth has type int64; int32 is needed"),
    ("depth", np.zeros((7, 1), np.int32), r"depth has shape \(7, 1\); \(N,\) is needed"),
    ("depth", np.array([0, 1, 2, 3, 4, 5, 5], np.int32), "depth is not an order of the strokes"),
    ("depth", np.arange(6, dtype=np.int32), r"position has shape \(7, 2\); \(6, 2\) is needed"),
    ("opacity", np.array([0, 1, 0, 0, 0, 2, 0], np.float32), r"stroke 5: opacity is 2; it must lie in \[0, 1\]"),
    ("scale", np.array([1, 1, np.inf, 1, 1, 1, 1], np.float32), "stroke 2: scale is inf"),
    ("color", np.full((7, 3), np.nan, np.float32), "stroke 0: color is nan, nan, nan"),
])  # fmt: skip
def test_a_wrong_dataset_is_explained(stored, name, data, message):
    with h5py.File(stored, "a") as file:
        del file[name]
        file.create_dataset(name, data=data).attrs["unit"] = ""
    assert re.search(message, refused(stored))


def test_a_missing_part_of_a_dataset_is_explained(stored):
    for spoil, message in (
        (lambda file: file["scale"].attrs.pop("unit"), "dataset scale has no attribute unit"),
        (lambda file: file.pop("depth"), "has no dataset depth"),
        (lambda file: file.create_group("depth"), "has no dataset depth"),
    ):
        with h5py.File(stored, "a") as file:
            spoil(file)
        assert message in refused(stored)


UNITS = {"position": 1.0, "start": 1.0, "control": 1.0, "end": 1.0, "width": 0.3, "color": 1.0, "opacity": 0.5}


def assert_equal(one, other):
    torch.testing.assert_close(dict(one.items()), dict(other.items()))


@pytest.mark.parametrize("n", [0, 20])
def test_a_catalogue_gives_back_its_strokes(n):
    catalogue = Catalogue(random_strokes(n, (30, 40)), UNITS)
    catalogue.keep_in_range()
    assert_equal(catalogue(), random_strokes(n, (30, 40)))


def test_a_step_of_one_rate_moves_each_field_by_its_unit_and_the_scale_can_move_instead_of_the_position():
    strokes = random_strokes(5, (30, 40))
    catalogue = Catalogue(strokes, UNITS)
    optimizer = torch.optim.SGD(catalogue.parameters(), lr=1e-3)
    sum(parameter.sum() for parameter in catalogue.parameters()).backward()
    optimizer.step()
    moved = catalogue()
    assert all(bool((getattr(moved, name) != getattr(strokes, name)).any()) for name in UNITS)
    torch.testing.assert_close(moved.width, strokes.width - 1e-3 * 0.3)
    torch.testing.assert_close(moved.position, strokes.position - 1e-3 * 0.5 * strokes.scale[:, None])
    assert torch.equal(moved.scale, strokes.scale), "a field without a unit must not move"
    catalogue = Catalogue(random_strokes(5, (30, 40)), {"scale": 10.0})
    catalogue().scale.sum().backward()
    torch.testing.assert_close(catalogue.scale.grad, torch.full((5,), 10.0))
    refuses("set the rate of scale to 0", Catalogue, random_strokes(5, (30, 40)), {"scale": 10.0, "position": 1.0})


def test_numbers_out_of_range_are_brought_back_but_named_when_they_are_given():
    strokes = random_strokes(4, (30, 40))
    catalogue = Catalogue(strokes, UNITS)
    with torch.no_grad():
        catalogue.color[0, 0] = 7.0
        catalogue.opacity[1] = -3.0
        catalogue.width[2] = -1.0
        catalogue.start[3, 0] = torch.nan
        catalogue.position[0, 1] = torch.inf
    catalogue.keep_in_range()
    check_strokes(catalogue())
    refuses("no stroke field is called 'colour'; the fields are position, scale", Catalogue, strokes, {"colour": 1.0})
    strokes.control[2, 1] = torch.nan
    refuses(r"stroke 2: control is .*nan; it must lie in \[-1000, 1000\]", Catalogue, strokes, UNITS)


def test_strokes_of_a_loop_are_brought_back_or_replaced_in_place_whatever_their_units():
    strokes = random_strokes(3, (20, 30)).map(lambda value: value.requires_grad_())
    with torch.no_grad():
        strokes.color[0] = torch.tensor([-0.5, 0.25, 1.5])
        strokes.opacity[1], strokes.width[2], strokes.scale[0] = math.nan, -1.0, -math.inf
    leaf = strokes.color
    assert strokes.clamp() is strokes
    check_strokes(strokes)
    assert strokes.color is leaf
    assert leaf.is_leaf
    assert leaf[0].tolist() == [0.0, 0.25, 1.0]
    assert (strokes.opacity[1].item(), strokes.width[2].item()) == (0.0, 0.0)
    units = UNITS | {"width": 0.0, "color": 0.3}
    catalogue, new = Catalogue(random_strokes(6, (30, 40)), units), random_strokes(6, (30, 40), seed=9)
    held = {name: parameter for name, parameter in catalogue.named_parameters()}
    catalogue.replace(new)
    assert_equal(catalogue(), new)
    assert all(parameter is held[name] for name, parameter in catalogue.named_parameters())


def test_strokes_that_stay_keep_their_optimiser_state():
    strokes, new = random_strokes(6, (30, 40)), random_strokes(3, (30, 40), seed=9)
    catalogue = Catalogue(strokes, UNITS)
    optimizer = torch.optim.Adam(catalogue.parameters(), lr=0.01)
    for _ in range(3):
        optimizer.zero_grad()
        sum(parameter.square().sum() for parameter in catalogue.parameters()).backward()
        optimizer.step()
    before, momentum = catalogue(), optimizer.state[catalogue.start]["exp_avg"].clone()
    keep = torch.tensor([True, False, True, True, False, True])
    catalogue.revise(keep, new, optimizer)
    assert_equal(catalogue()[:4], before[keep].map(torch.Tensor.detach))
    assert_equal(catalogue()[4:], new)
    state = optimizer.state[catalogue.start]
    torch.testing.assert_close(state["exp_avg"][:4], momentum[keep])
    assert (state["exp_avg"][4:] == 0).all()
    assert float(state["step"]) == 3
    assert catalogue.brush.tolist() == [0, 2, 3, 5, 4, 5, 6], "and the look that renderers give them"
    again = Catalogue(random_strokes(7, (30, 40)), UNITS)
    again.load_state_dict(catalogue.state_dict())
    assert torch.equal(again().map(torch.Tensor.double)[2:].brush, catalogue.brush[2:])
    optimizer.zero_grad()
    catalogue().start.sum().backward()
    optimizer.step()  # the optimiser moves the new parameters
    assert not torch.equal(catalogue().start[4:], new.start)
