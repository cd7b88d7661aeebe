"""The plugins and the preset of docs/tutorial.md do what it says: each keeps the contract of its family."""

import os
import re
import subprocess
import sys
import textwrap
import tomllib
from pathlib import Path

import pytest
from catalogues import catalogue
from hydra.errors import ConfigCompositionException
from program import ROOT, publish

from brushexp.config import compose
from brushexp.config.check import check
from brushexp.config.compose import folders_of
from brushexp.config.publish import offer_presets, prepare
from brushexp.errors import UserError
from brushexp.registry import MULTI_SELECT, build
from brushexp.strokes.storage import save_catalogue

TEXT = (ROOT / "docs" / "tutorial.md").read_text()
BLOCKS = {
    name: textwrap.dedent(block)
    for block, name in re.findall(r"((?:^    # (\S+)\n)(?:^(?:    .*)?\n)+)", TEXT, re.MULTILINE)
}
NAMES = {Path(name).stem for name in BLOCKS if name.endswith(".py")}
PACKAGE = ROOT / "examples" / "plugin-package"


@pytest.mark.slow
def test_the_plugins_of_the_tutorial_and_of_the_package_keep_their_contracts(tmp_path):
    assert {"calm", "raster", "marker", "glaze"} == NAMES
    examples = [path.stem for path in (ROOT / "examples" / "plugins").glob("*.py")]
    for name in NAMES:
        (tmp_path / f"{name}.py").write_text(BLOCKS[f"plugins/{name}.py"])
    command = [sys.executable, "-m", "pytest", "-n", "0", "-p", "no:cacheprovider"]
    command += ["-k", " or ".join([*NAMES, *examples, "dabs"]), "tests/test_plugins.py", str(PACKAGE)]
    project = tomllib.loads((PACKAGE / "pyproject.toml").read_text())["project"]
    publish(tmp_path, project["name"], project["version"], project["entry-points"]["brushexp.plugins"])
    path = [str(tmp_path), str(PACKAGE / "src"), os.environ.get("PYTHONPATH", "")]
    environment = os.environ | {
        "BRUSHEXP_PLUGINS": f"{tmp_path}{os.pathsep}{ROOT / 'examples' / 'plugins'}",
        "PYTHONPATH": os.pathsep.join(path),
    }
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-4000:]
    assert int(re.search(r"(\d+) passed", done.stdout)[1]) >= 56


PRESETS = {
    "loss/mse_strong": BLOCKS["conf/loss/mse_strong.yaml"],
    "loss/stronger": "defaults: [mse_strong]\nweight: 3.0\n",
    "loss/own_package": "# @package loss.own_package\ndefaults: [mse@_here_, _self_]\nweight: 4.0\n",
    "loss/both": "defaults: [mse, l1, _self_]\nmse:\n  weight: 5.0\n",
    "metric/likeness": "defaults: [ssim]\n",
    "to/large": "defaults: [png]\n",
    "logger/table": "defaults: [csv]\n",
    "callbacks/rates": "defaults: [learning_rate_monitor]\n",
}


@pytest.fixture
def presets(tmp_path, hydra_restore_singletons):
    """Folder of configs with presets of families of which several can be chosen."""
    for name, text in PRESETS.items():
        path = tmp_path / "conf" / f"{name}.yaml"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    prepare(tmp_path)
    return folders_of(tmp_path)


def composed(folders, *overrides):
    cfg = compose.composed(overrides, folders)
    check(cfg)
    return cfg


WEIGHTS = {
    "[mse,mse_strong]": {"mse": 1.0, "mse_strong": 2.0},
    "stronger": {"stronger": 3.0},
    "own_package": {"own_package": 4.0},
    "both": {"mse": 5.0, "l1": 1.0},
}


def test_a_preset_of_a_loss_is_a_loss_of_that_name(presets):
    for chosen, weights in WEIGHTS.items():
        cfg = composed(presets, f"loss={chosen}")
        assert {name: node.weight for name, node in cfg.loss.items()} == weights
        assert all(build(node).weight == weights[name] for name, node in cfg.loss.items())


def test_a_preset_is_typed_and_tuned_as_its_plugin_is(presets):
    assert composed(presets, "loss=mse_strong", "loss.mse_strong.weight=7").loss.mse_strong.weight == 7.0
    with pytest.raises(ConfigCompositionException):
        composed(presets, "loss=mse_strong", "loss.mse_strong.weight=much")
    with pytest.raises(UserError, match=r"loss\.mse_strong\.weight=-1 is not at least 0"):
        composed(presets, "loss=mse_strong", "loss.mse_strong.weight=-1")


def test_presets_work_in_every_family_of_which_several_can_be_chosen(presets, tmp_path):
    save_catalogue(tmp_path / "a.h5", catalogue())
    cfg = composed(presets, "logger=[table,csv]", "callbacks=[rates]")
    assert (list(cfg.logger), list(cfg.callbacks)) == (["table", "csv"], ["rates"])
    assert list(composed(presets, "task=export", "to=[large,svg]", f"catalogue={tmp_path}/a.h5").to) == ["large", "svg"]
    assert {path.partition("/")[0] for path in PRESETS} == set(MULTI_SELECT)


@pytest.mark.parametrize(("name", "text", "message"), [
    ("mse", "defaults: [l1]\n", "has the name of the plugin loss=mse; give the file another name"),
    ("odd", "defaults: [mse]\nwieght: 2.0\n", r"odd\.yaml does not fit loss=mse: .*wieght"),
    ("odd", "defaults: [mse]\nweight: much\n", r"odd\.yaml does not fit loss=mse: .*much"),
])  # fmt: skip
def test_a_preset_that_fits_no_plugin_is_refused(tmp_path, name, text, message):
    (tmp_path / f"{name}.yaml").write_text(text)
    with pytest.raises(UserError, match=message):
        offer_presets("loss", {name: tmp_path / f"{name}.yaml"})
