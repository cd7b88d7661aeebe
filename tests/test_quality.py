"""Presets of quality: what you type wins over an experiment, an experiment over a preset, a preset over the task."""

import re
import shutil
from pathlib import Path

import pytest
from hydra import compose, initialize_config_dir
from program import ROOT, run

from brushexp.app.composition import check

PRESETS = {path.stem: path for path in (ROOT / "conf" / "quality").glob("*.yaml")}
STUDIES = ["thesis", "steps", "renderers"]


@pytest.fixture(scope="module")
def conf(tmp_path_factory) -> Path:
    """The configs, and a preset and a study that choose plugins."""
    folder = tmp_path_factory.mktemp("configs") / "conf"
    shutil.copytree(ROOT / "conf", folder)
    head = "# @package _global_\n# it\n"
    toy = head + "defaults:\n  - override /optimizer: soap\n\nsteps: 7\n"
    (folder / "quality" / "toy.yaml").write_text(toy)
    study = head + "defaults:\n  - override /quality: toy\n  - override /optimizer: lbfgs\n\npixels_per_stroke: 33\n"
    (folder / "experiment" / "toy.yaml").write_text(study)
    return folder


def composed(conf: Path, *overrides: str):
    with initialize_config_dir(version_base="1.3", config_dir=str(conf)):
        return compose("config", overrides=list(overrides))


def test_the_presets_are_those_that_the_docs_name():
    assert set(PRESETS) >= {"draft", "normal", "fine", "best"}


@pytest.mark.parametrize("preset", PRESETS)
def test_a_preset_composes_with_everything(config, preset):
    for overrides in ([], ["density=fixed"], *([f"experiment={study}"] for study in STUDIES)):
        cfg = config(f"quality={preset}", *overrides)
        check(cfg)
    cfg = config(f"quality={preset}", "steps=3", "pixels_per_stroke=77", "density=fixed")
    assert (cfg.steps, cfg.pixels_per_stroke) == (3, 77)
    assert cfg.density._target_.endswith("Fixed")


@pytest.mark.parametrize("preset", PRESETS)
def test_a_preset_says_what_was_measured(preset):
    head = PRESETS[preset].read_text().splitlines()
    assert head[0] == "# @package _global_"
    assert re.match(r"# \d+(\.\d+)? dB in \d+(\.\d+)? (s|min)\b", head[1])


def test_the_default_is_normal(config):
    assert config() == config("quality=normal")


def test_better_takes_longer(config):
    names = ("draft", "normal", "fine", "best")
    work = [cfg.steps / cfg.pixels_per_stroke for cfg in (config(f"quality={name}") for name in names)]
    assert work == sorted(set(work))
    said = [re.findall(r"[\d.]+", PRESETS[name].read_text().splitlines()[1])[:2] for name in names]
    for figures in zip(*said, strict=True):  # decibels, and seconds
        assert list(map(float, figures)) == sorted(map(float, figures))


def test_what_you_type_wins_over_a_study_over_a_preset_over_the_task(conf):
    cfg = composed(conf, "quality=toy")
    assert (cfg.steps, cfg.pixels_per_stroke, cfg.optimizer.name) == (7, 100, "SOAP")
    cfg = composed(conf, "experiment=toy")
    assert (cfg.steps, cfg.pixels_per_stroke, cfg.optimizer.name) == (7, 33, "LBFGS")
    cfg = composed(conf, "experiment=toy", "steps=5", "optimizer=sgd")
    assert (cfg.steps, cfg.pixels_per_stroke, cfg.optimizer.name) == (5, 33, "SGD")
    cfg = composed(conf, "experiment=toy", "quality=best")
    assert (cfg.steps, cfg.pixels_per_stroke) == (composed(conf, "quality=best").steps, 33)


def test_help_shows_what_each_preset_takes(tmp_path):
    shown = run("--help", cwd=tmp_path)
    assert shown.returncode == 0, shown.stderr
    lines = [line.strip() for line in shown.stdout.splitlines()]
    for name, path in PRESETS.items():
        summary = path.read_text().splitlines()[1].removeprefix("# ")
        assert any(line.startswith(f"{name} ") and line.endswith(summary) for line in lines), name
