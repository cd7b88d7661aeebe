"""A sweep over a list of settings: each is a job of its own, whatever the command line adds."""

import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from hydra import initialize_config_dir
from hydra.core.global_hydra import GlobalHydra
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.plugins import Plugins
from hydra.errors import HydraException

ROOT = Path(__file__).parents[1]


def jobs(settings, arguments=(), batch=None):
    """The overrides of every job, in batches."""
    with initialize_config_dir(version_base="1.3", config_dir=str(ROOT / "conf")):
        loader = GlobalHydra.instance().config_loader()
        found = Plugins.instance().class_name_to_class["hydra_plugins.brushexp_settings.SettingsSweeper"]
        sweeper = found(batch, None, settings)
        sweeper.hydra_context = SimpleNamespace(config_loader=loader)
        overrides = OverridesParser.create(config_loader=loader).parse_overrides(list(arguments))
        return sweeper.split_arguments(overrides, batch)


def test_every_setting_is_one_job():
    settings = ["", "steps=100", "init=grid 'loss=[mse,kl]' +a.b=1"]
    assert jobs(settings) == [[[], ["steps=100"], ["init=grid", "loss=[mse,kl]", "+a.b=1"]]]


def test_settings_are_combined_with_what_the_command_line_sweeps():
    (found,) = jobs(["", "steps=9"], ["image=a,b", "seed=0,1", "frames=0"])
    assert len(found) == 8
    assert found[0] == ["image=a", "seed=0", "frames=0"]
    assert found[-1] == ["image=b", "seed=1", "frames=0", "steps=9"]


def test_a_setting_stands_above_the_command_line_and_may_sweep_itself():
    (found,) = jobs(["", "steps=9", "steps=1,2"], ["steps=50", "seed=0"])
    assert found == [["steps=50", "seed=0"], *(["steps=" + n, "seed=0"] for n in ("9", "1", "2"))]


def test_jobs_come_in_batches():
    assert [len(batch) for batch in jobs(["", "a=1", "a=2"], ["b=1,2"], batch=4)] == [4, 2]


def test_a_setting_that_is_no_override_is_refused():
    with pytest.raises(HydraException, match="steps"):
        jobs(["steps"])


APP = """
import hydra
@hydra.main(version_base="1.3", config_path="conf", config_name="config")
def main(cfg):
    print("job", cfg.steps, cfg.seed)
main()
"""
STUDY = """# @package _global_
defaults:
  - override /hydra/sweeper: settings
hydra:
  mode: MULTIRUN
  sweeper:
    params: {seed: "3,4"}
    settings: ["", steps=9]
"""


@pytest.mark.parametrize(
    ("arguments", "shown"),
    [
        (["experiment=study"], ["1 3", "1 4", "9 3", "9 4"]),
        (["experiment=study", "seed=5", "steps=2"], ["2 5", "9 5"]),
        (["experiment=study", "hydra.mode=RUN", "steps=7"], ["7 0"]),
        (["-m", "hydra/sweeper=settings", "hydra.sweeper.settings=['steps=4','seed=6']"], ["4 0", "1 6"]),
        (["experiment=study", "hydra.sweeper.settings=['stepz=4']"], []),
    ],
)
def test_hydra_finds_the_sweeper(tmp_path, arguments, shown):
    (tmp_path / "conf" / "experiment").mkdir(parents=True)
    text = "defaults: [_self_, {experiment: null}]\nsteps: 1\nseed: 0\nhydra: {sweep: {dir: out}, run: {dir: out}}\n"
    (tmp_path / "conf" / "config.yaml").write_text(text)
    (tmp_path / "conf" / "experiment" / "study.yaml").write_text(STUDY)
    (tmp_path / "app.py").write_text(APP)
    command = [sys.executable, "app.py", *arguments]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False, env=dict(os.environ))
    assert [line[4:] for line in done.stdout.splitlines() if line.startswith("job ")] == shown, done.stderr
    assert (done.returncode == 0) == bool(shown)
    assert shown or "stepz" in done.stderr
