"""Every named study composes, and its jobs can be told apart."""

import shlex
from pathlib import Path

import pytest
from hydra import compose, initialize_config_dir

from brushexp.app.composition import check
from brushexp.registry import build

ROOT = Path(__file__).parents[1]
STUDIES = sorted(path.stem for path in (ROOT / "conf" / "experiment").glob("*.yaml"))


@pytest.mark.parametrize("study", STUDIES)
def test_a_study_composes_and_asks_a_question(study):
    text = (ROOT / "conf" / "experiment" / f"{study}.yaml").read_text().splitlines()
    assert text[0] == "# @package _global_"
    assert "?" in text[1]
    assert f"experiment={study}" in text[1]
    with initialize_config_dir(version_base="1.3", config_dir=str(ROOT / "conf")):
        cfg = compose("config", overrides=[f"experiment={study}"])
    for node in cfg.get("loss", {}).values():  # a task without paintings has none
        build(node)


def settings_of(study):
    with initialize_config_dir(version_base="1.3", config_dir=str(ROOT / "conf")):
        cfg = compose("config", overrides=[f"experiment={study}"], return_hydra_config=True)
    listed = list(cfg.hydra.sweeper.settings)
    return listed if len(listed) > 1 else []


SETTINGS = [(study, setting) for study in STUDIES for setting in settings_of(study)]


@pytest.mark.parametrize(("study", "setting"), SETTINGS)
def test_every_setting_of_a_list_composes(study, setting):
    with initialize_config_dir(version_base="1.3", config_dir=str(ROOT / "conf")):
        cfg = compose("config", overrides=[f"experiment={study}", *shlex.split(setting)])
    check(cfg)
    for name in (*cfg.loss.values(), cfg.renderer, cfg.blend, cfg.sampler, cfg.density, cfg.order):
        build(name)


@pytest.mark.parametrize("study", sorted({study for study, _ in SETTINGS}))
def test_no_setting_stands_in_a_list_twice(study):
    listed = [tuple(sorted(shlex.split(setting))) for name, setting in SETTINGS if name == study]
    assert len(set(listed)) == len(listed) > 1
