"""Test that paintings from an earlier version, in which changes were separate keys and tasks, can still be opened.

The folder earlier/ contains two runs of 40 steps, interrupted after 25 and 18 steps, and the uninterrupted results:

    brushexp coffee resolution=32 strokes=12 steps=40 look=oil wet=0.4 variety=0.3
    brushexp coffee resolution=32 strokes=12 steps=40 tubes=zorn mixtures=4 brushes=[60,30] width_cm=25 load=9
"""

import shutil
from pathlib import Path

import pytest
from brushexp_changes.tubes.recorded import recorded_plan
from program import ended
from torch.testing import assert_close

import brushexp
from brushexp.painting.reopen import export_job, recorded_settings
from brushexp.registry import keep_built, plain_config
from brushexp.strokes.storage import load_catalogue
from brushexp.system.earlier import todays_key, todays_settings
from brushexp.system.reading import json_of, read_text

EARLIER = Path(__file__).parent / "earlier"
CHANGES = {
    "paint": {"variety": {"amount": 0.3}, "wet": {"amount": 0.4}},
    "tubes": {
        "variety": {"amount": 0.0},
        "tubes": {"tubes": "zorn", "mixtures": 4, "brushes": [60.0, 30.0], "width_cm": 25.0, "load": 9.0},
    },
}


def without_target(node):
    return {key: value for key, value in node.items() if key != "_target_"}


@pytest.mark.parametrize("name", CHANGES)
def test_an_interrupted_run_ends_as_the_one_that_was_not(tmp_path, name):
    shutil.copytree(EARLIER / name, tmp_path / name)
    code, output = ended(tmp_path, f"resume={name}")
    assert code == 0, output
    saved, whole = (load_catalogue(tmp_path / name / file) for file in ("catalogue.h5", "whole.h5"))
    rounding = 2e-3  # processors round differently, and the focus has changed since
    assert_close(dict(saved.strokes.items()), dict(whole.strokes.items()), rtol=0, atol=rounding)
    assert (saved.depth == whole.depth).all()
    assert json_of(read_text(tmp_path / name / "metrics.json", ""))["steps"] == 40


@pytest.mark.parametrize("name", CHANGES)
def test_a_catalogue_tells_its_changes_under_the_keys_of_today_and_they_can_be_built(name):
    settings = recorded_settings(load_catalogue(EARLIER / name / "whole.h5"))
    assert {key: without_target(node) for key, node in settings["change"].items()} == CHANGES[name]
    assert settings["task"] == "paint"
    assert not {"variety", "wet", "tubes", "mixtures", "brushes", "width_cm", "load"} & settings.keys()
    for family in ("change", "metric"):
        for node in settings[family].values():
            keep_built(plain_config(node))


def test_a_painting_by_tubes_is_planned_with_its_own_table_and_any_can_be_drawn_and_painted_on():
    plan, is_own = recorded_plan(export_job(load_catalogue(EARLIER / "tubes" / "whole.h5")), {})
    assert is_own
    assert plan.brushes_mm == [60.0, 30.0]
    for name in CHANGES:
        catalogue = EARLIER / name / "whole.h5"
        assert export_job(load_catalogue(catalogue)).picture().std() > 10
        painting = brushexp.paint("coffee", catalogue=str(catalogue), resolution=32, steps=1, look="plain", threads=1)
        assert len(painting.strokes) == len(load_catalogue(catalogue).strokes)


def test_tasks_and_callbacks_of_then_are_changes_of_now():
    plain = {"variety": 0.0, "wet": 0}
    guided = todays_settings({"task": "guided", "guides": "coffee", **plain})
    assert (guided["task"], guided["change"]["guides"]["lines"]) == ("paint", "coffee")
    repaint = todays_settings({"task": "repaint", "region": "camera", "catalogue": "x", **plain})
    assert (repaint["catalogue"], repaint["change"]["region"]["mask"]) == ("x", "camera")
    callbacks = {"sizes": {"smallest": "2"}, "random_ground": {"until": 0.5}, "lr_monitor": {"_target_": "a.B"}}
    beside = todays_settings({"task": "paint", "callbacks": callbacks, **plain})
    assert beside["callbacks"] == {"lr_monitor": {"_target_": "a.B"}}
    assert beside["change"]["sizes"] == {"smallest": "2", "_target_": "change/sizes"}
    assert beside["change"]["random_ground"] == {"until": 0.5, "_target_": "change/random_ground"}
    looks = {"wet_steps": {"every": 5, "after": 0.3, "wet": None}}
    wet = todays_settings({"task": "paint", "callbacks": looks, "variety": 0.0, "wet": 0.5})["change"]["wet"]
    assert without_target(wet) == {"amount": 0.5, "every": 5, "after": 0.3}
    for settings in (guided, repaint, beside):
        assert todays_settings(settings) == settings, "current settings stay unchanged"
        for node in settings["change"].values():
            keep_built(plain_config(node))
    assert todays_key("region", {"task": "repaint", **plain}) == "change.region.mask"
    assert todays_key("region", beside) == "region"
