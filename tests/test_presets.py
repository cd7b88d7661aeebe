"""Tests that quality presets and studies compose, and that words override studies, which override presets."""

import re
import shlex

import pytest
from typed import configured

from brushexp.config import compose
from brushexp.config.check import check
from brushexp.config.compose import files_of
from brushexp.config.publish import offer
from brushexp.registry import build, plugin_of
from brushexp.system.reading import read_text, yaml_of
from brushexp.system.words import SHIPPED, conf_folders

PRESETS = files_of(SHIPPED, "quality")
STUDIES = {name: path for folder in conf_folders() for name, path in files_of(folder, "experiment").items()}
LADDER = ("draft", "normal", "fine", "best")


def composed(*words: str, own=()):
    return compose.compose_config(words, [*conf_folders(), *own])


def listed(study: str) -> list[str]:
    """Return the list of a study's settings, one for each job."""
    return yaml_of(read_text(STUDIES[study], "")).get("hydra", {}).get("sweeper", {}).get("settings", [])


@pytest.mark.parametrize("preset", PRESETS)
def test_a_preset_composes_with_everything_and_says_what_was_measured(preset):
    check(composed(f"quality={preset}"))
    for study in ("thesis", "steps", "renderers") if preset == "draft" else ("thesis",):
        check(composed(f"quality={preset}", f"experiment={study}"))
    cfg = composed(f"quality={preset}", "steps=3", "pixels_per_stroke=77", "density=fixed")
    assert (cfg.steps, cfg.pixels_per_stroke) == (3, 77)
    assert cfg.density._target_ == "density/fixed"
    check(cfg)
    head = PRESETS[preset].read_text().splitlines()
    assert head[0] == "# @package _global_"
    figures = r"\(look=\w+: \d+(\.\d+)? dB in \d+(\.\d+)? (s|min)\)$"
    assert re.search(figures if preset in LADDER else rf"{figures}|\(plain and even: the same as \w+\)$", head[1])


def test_better_takes_longer_and_normal_is_the_default():
    assert set(PRESETS) >= set(LADDER)
    assert composed() == composed("quality=normal")
    work = [cfg.steps / cfg.pixels_per_stroke for cfg in (composed(f"quality={name}") for name in LADDER)]
    assert work == sorted(set(work))
    measured = [re.findall(r"[\d.]+", PRESETS[name].read_text().splitlines()[1])[:2] for name in LADDER]
    for figures in zip(*measured, strict=True):  # decibels, and seconds
        assert list(map(float, figures)) == sorted(map(float, figures))


def test_what_you_type_wins_over_a_study_over_a_preset_over_the_task(tmp_path):
    for group in ("quality", "experiment"):
        (tmp_path / group).mkdir()
    head = "# @package _global_\n# it\ndefaults:\n"
    toy = head + "  - override /optimizer: soap\n\nsteps: 7\n"
    (tmp_path / "quality" / "toy.yaml").write_text(toy)
    study = head + "  - override /quality: toy\n  - override /optimizer: lbfgs\n\npixels_per_stroke: 33\n"
    (tmp_path / "experiment" / "toy.yaml").write_text(study)
    for typed, expected in {
        "quality=toy": (7, 100, "SOAP"),
        "experiment=toy": (7, 33, "LBFGS"),
        "experiment=toy steps=5 optimizer=sgd": (5, 33, "SGD"),
        "experiment=toy quality=best": (composed("look=plain", "quality=best").steps, 33, "LBFGS"),
    }.items():
        cfg = composed("look=plain", *typed.split(), own=[tmp_path])
        assert (cfg.steps, cfg.pixels_per_stroke, cfg.optimizer.name) == expected, typed


@pytest.mark.parametrize(("words", "name", "checkpoint"), [
    ("look=plain", "predicted", "plain"),
    ("", "layers", None),
    ("quality=glance", "predicted", "brushed"),
    ("quality=glance look=ink", "drawing", None),
    ("look=ink", "drawing", None),
    ("look=vangogh", "rows", None),
    ("look=oil init=layers", "layers", None),
])  # fmt: skip
def test_a_draft_begins_with_strokes_of_a_network_but_for_starts_that_make_a_look(words, name, checkpoint):
    init = composed(*[] if "quality=" in words else ["quality=draft"], *words.split()).init
    assert (plugin_of(init).name, init.get("checkpoint")) == (name, checkpoint)
    same = composed(*words.split(), f"init={name}").init
    own = {} if checkpoint is None else {"checkpoint": checkpoint, "draft_effort": init.draft_effort}
    same.update(own)
    assert init == same, "with the options of the look"


@pytest.mark.parametrize(("words", "effort", "rate"), [
    ("look=plain", 0.028, 0.03),
    ("look=plain init=slic", 0.1, 0.03),
    ("look=plain optimizer=adam", 0.028, 0.02),
    ("look=oil", 0.34, 0.02),
    ("look=vangogh", 0.34, 0.008),
])  # fmt: skip
def test_a_draft_takes_fewer_steps_from_strokes_of_a_network_and_the_rates_of_its_look(words, effort, rate):
    draft = composed("quality=draft", *words.split())
    assert (draft.effort, draft.optimizer.lr) == (effort, rate)


@pytest.mark.parametrize("preset", ["draft", "glance"])
def test_a_draft_keeps_the_strokes_of_its_start_except_in_a_medium(preset):
    densities = [composed(f"quality={preset}", f"look={look}").density for look in ("plain", "even", "oil")]
    assert [plugin_of(density).name for density in densities] == ["fixed", "fixed", "strays"]


def test_a_finer_quality_places_strokes_as_the_look_does_and_otherwise_where_the_error_is():
    looks = ("plain", "even", "oil", "ink")
    densities = [composed("quality=fine", f"look={look}").density for look in looks]
    assert [plugin_of(density).name for density in densities[:3]] == ["traced", "adaptive", "strays"]
    assert densities[3] == composed("look=ink").density, "a medium keeps its own"
    assert densities[0] == composed("look=plain").density, "with the options of the look"


def test_a_draft_keeps_an_optimizer_that_a_look_tunes(tmp_path):
    (tmp_path / "look").mkdir()
    (tmp_path / "look" / "still.yaml").write_text("# @package _global_\n# it\noptimizer:\n  units: {position: 0}\n")
    offer([*conf_folders(), tmp_path])
    draft = composed("quality=draft", "look=still", own=[tmp_path])
    offer(conf_folders())
    assert (plugin_of(draft.init).name, draft.optimizer.lr, draft.optimizer.units.position) == ("predicted", 0.02, 0)


MEDIA = ("oil", "gouache", "impasto", "ink", "pastel", "pointillist", "vangogh", "watercolour")


@pytest.mark.parametrize("look", MEDIA)
def test_in_a_medium_quality_keeps_the_size_of_strokes_and_takes_more_steps(look):
    ladder = [composed(f"look={look}", f"quality={name}") for name in LADDER]
    normal = ladder[LADDER.index("normal")]
    for cfg in ladder:
        assert (cfg.pixels_per_stroke, cfg.max_strokes) == (normal.pixels_per_stroke, normal.max_strokes)
        assert (cfg.init, cfg.density, cfg.optimizer) == (normal.init, normal.density, normal.optimizer)
    assert [cfg.steps for cfg in ladder] == [round(times * normal.steps) for times in (0.34, 1, 2, 4)]
    typed = composed(f"look={look}", "quality=best", "density=adaptive", "detail=2", "effort=1")
    assert typed.pixels_per_stroke == normal.pixels_per_stroke / 2
    assert (plugin_of(typed.density).name, typed.steps) == ("adaptive", normal.steps)


@pytest.mark.parametrize("look", [*MEDIA, "plain"])
def test_nearer_makes_strokes_smaller_in_any_look(look):
    nearer, normal = composed(f"look={look}", "quality=nearer"), composed(f"look={look}")
    assert nearer.pixels_per_stroke == normal.pixels_per_stroke / 4
    assert plugin_of(nearer.density).name == "adaptive"


@pytest.mark.parametrize("study", STUDIES)
def test_a_study_composes_and_asks_a_question(study):
    head = STUDIES[study].read_text().splitlines()
    assert head[0] == "# @package _global_"
    assert "?" in head[1]
    assert f"experiment={study}" in head[1]
    for node in composed(f"experiment={study}").get("loss", {}).values():  # a task without paintings has none
        build(node)
    settings = [tuple(sorted(shlex.split(setting))) for setting in listed(study)]
    assert len(set(settings)) == len(settings), "each once"


@pytest.mark.parametrize("study", [study for study in STUDIES if len(listed(study)) > 1])
def test_every_setting_of_a_list_is_valid(study):
    for setting in listed(study):
        check(configured([f"experiment={study}", *shlex.split(setting)]))  # which also builds the plugins
