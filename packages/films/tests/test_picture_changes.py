"""Test that changes are distinguished from noise, and cuts from pans, and that flicker and motion are measured."""

import pytest
import torch
from brushexp_films.changes import Changes, Flicker, difference, is_cut, optical_flow
from films import as_tensor, scene

from brushexp.config.compose import compose_config
from brushexp.registry import plugin_of


@pytest.mark.parametrize(("words", "name", "checkpoint"), [
    ("look=plain", "predicted", "plain"),
    ("look=oil", "predicted", "brushed"),
    ("look=oil quality=draft", "layers", None),
    ("look=ink", "drawing", None),
    ("look=vangogh", "rows", None),
    ("look=oil init=layers", "layers", None),
])  # fmt: skip
def test_scenes_begin_with_strokes_of_a_network_but_for_starts_that_make_a_look(words, name, checkpoint):
    film, painting = (compose_config([f"task={of}", *words.split()]) for of in ("film", "paint"))
    assert (plugin_of(film.init).name, film.init.get("checkpoint")) == (name, checkpoint)
    assert (film.steps, film.detail) == (painting.steps, painting.detail)


def test_changes_are_told_from_noise_and_slow_ones_are_seen_in_the_end():
    generator = torch.Generator().manual_seed(0)
    still = as_tensor(scene(1)[0])
    changes = Changes(0.04)
    assert changes(still).all()
    for _ in range(10):
        assert not changes((still + 0.01 * torch.randn(still.shape, generator=generator)).clamp(0, 1)).any()
    noticed = [bool(changes(0.9 * still + 0.005 * k).any()) for k in range(20)]
    assert sum(noticed) > 1, "fades below the threshold per picture are noticed eventually"
    assert difference(changes.held, 0.9 * still + 0.095).max() <= 0.04 + 0.01


def test_a_change_is_found_where_it_is_and_a_cut_is_told_from_a_pan():
    first, second = (as_tensor(picture) for picture in scene(2, speed=8))
    changes = Changes(0.04)
    changes(first)
    changed = changes(second)
    assert not changes.begins
    where = (first != second).any(0)
    assert changed[where].float().mean() > 0.8
    assert not changed[60:].any()
    assert not is_cut(first, first.roll(6, 2))
    assert is_cut(first, 1 - first)
    changes(1 - first)
    assert changes.begins


def test_flicker_is_the_mean_change_where_the_target_stays():
    generator = torch.Generator().manual_seed(0)
    targets = [as_tensor(picture) for picture in scene(4)]
    paintings = [torch.rand(target.shape, generator=generator) for target in targets]
    flicker, total, count = Flicker(), 0.0, 0
    for painting, target in zip(paintings, targets, strict=True):
        flicker.add(painting, target)
    for k in range(1, 4):
        still = (difference(targets[k], targets[k - 1]) < 0.02).numpy()
        for row, column in zip(*still.nonzero(), strict=True):
            total += float((paintings[k] - paintings[k - 1])[:, row, column].abs().mean())
            count += 1
    assert flicker.value == pytest.approx(total / count, rel=1e-5)
    assert Flicker().value is None


@pytest.mark.parametrize("shift", [(4, 0), (0, -3)])
def test_motion_is_that_of_the_pictures(shift):
    first = as_tensor(scene(1, side=96)[0])
    flow = optical_flow(first, first.roll(shift, (2, 1)))[:, 16:-16, 16:-16]
    assert flow.flatten(1).median(1).values.tolist() == pytest.approx(shift, abs=0.5)
    assert not optical_flow(first[:, :8, :8], first[:, :8, :8]).any()
