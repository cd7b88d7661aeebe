"""Registering a class makes it a typed Hydra choice; plugins are found in three kinds of places."""

import os
import subprocess
import sys

import pytest
from brushexp_policies.strays import Strays
from omegaconf import OmegaConf
from program import ROOT, publish

from brushexp import registry
from brushexp.errors import UserError
from brushexp.plugin_loading import load_plugins
from brushexp.registry import build, build_named, plugins, register, structured_config

PLUGIN = """
from brushexp.plugins.order.base import Order
from brushexp.registry import register

@register("order", "{name}")
class Upside(Order):
    \"\"\"Upside down.\"\"\"
    def __init__(self, *, every: int = 3) -> None:
        self.every, self.needs_accuracy = every, False
    def depth(self, strokes, accuracy):
        return -strokes.opacity
"""


@pytest.fixture
def clean(monkeypatch):
    """Forget what a test registers."""
    monkeypatch.setattr(registry, "_plugins", dict(registry._plugins))


@pytest.mark.usefixtures("clean", "hydra_restore_singletons")  # Hydra ships the second one
def test_a_taken_name_and_an_unknown_family_are_refused():
    class Mse:
        def __init__(self, *, weight: float = 1.0) -> None: ...

    with pytest.raises(UserError, match=r"loss=mse is taken by brushexp\.plugins\.loss\.mse"):
        register("loss", "mse")(Mse)
    with pytest.raises(UserError, match="unknown plugin family 'losses'; choose one of painter, palette, init, "):
        register("losses", "x")


def test_options_are_typed_and_run_time_arguments_are_none():
    class Thing:
        def __init__(self, target, *, rows: int = 8, rate: float) -> None: ...

    class Untyped:
        def __init__(self, *, rows=8) -> None: ...

    assert list(structured_config(Thing).__dataclass_fields__) == ["_target_", "rows", "rate"]
    with pytest.raises(TypeError, match="give 'rows' a type"):
        structured_config(Untyped)


def test_defaults_are_not_shared(config):
    first = config("optimizer=torch").optimizer
    first.units["position"] = 99.0
    assert config("optimizer=torch").optimizer.units["position"] != 99.0


def test_only_registered_classes_are_built_and_options_from_a_file_are_checked():
    with pytest.raises(UserError, match=r"os\.system is not a registered plugin"):
        build(OmegaConf.create({"_target_": "os.system", "command": "true"}))
    assert build_named("renderer", "analytic", {"soft": 2.0}).soft == 2.0
    with pytest.raises(UserError, match="does not take these options"):
        build_named("renderer", "analytic", {"soft": "wide"})
    with pytest.raises(UserError, match=r"renderer=cubist is not among the plugins here \(analytic"):
        build_named("renderer", "cubist", {})


@pytest.mark.usefixtures("clean", "hydra_restore_singletons")
def test_plugins_in_folders_of_the_environment_are_found(tmp_path, monkeypatch):
    (tmp_path / "upside.py").write_text(PLUGIN.format(name="upside"))
    (tmp_path / "_helper.py").write_text("this is no plugin")
    monkeypatch.setenv("BRUSHEXP_PLUGINS", str(tmp_path))
    assert "upside" in load_plugins(ROOT / "plugins")
    plugin = next(p for p in plugins("order") if p.name == "upside")
    assert plugin.summary == "Upside down."
    assert build_named("order", "upside", {"every": 5}).every == 5


@pytest.mark.parametrize(("name", "text", "message"), [
    ("broken.py", "def broken(:\n", r"broken\.py, line 1: .*; correct it or move it away"),
    ("broken.py", "1 / 0\n", r"cannot be loaded: ZeroDivisionError: division by zero"),
    ("scatter.py", "", "have the same name; rename one"),
    (None, "", "BRUSHEXP_PLUGINS names /nowhere/at/all, which is not a folder"),
])  # fmt: skip
def test_a_broken_plugin_or_folder_stops_the_program(tmp_path, monkeypatch, name, text, message):
    if name:
        (tmp_path / name).write_text(text)
    monkeypatch.setenv("BRUSHEXP_PLUGINS", str(tmp_path) if name else "/nowhere/at/all")
    with pytest.raises(UserError, match=message):
        load_plugins(ROOT / "plugins")


def test_a_config_of_an_earlier_version_may_have_a_member_in_the_core():
    node = OmegaConf.create({"_target_": "brushexp.plugins.density.strays.Strays", "after": 0.5})
    assert type(build(node)) is Strays
    with pytest.raises(UserError, match="is not a registered plugin"):
        build(OmegaConf.create({"_target_": "brushexp.plugins.density.strays.Other"}))


def test_published_plugins_are_found_and_all_load_without_the_extras(tmp_path):
    (tmp_path / "published_order.py").write_text(PLUGIN.format(name="published"))
    publish(tmp_path, "published", "1.0", {"published": "published_order"})
    extras = ["av", "joblib", "torch_pruning", "pytorch_optimizer", "vpype", "vpype_cli", "shapely", "tensorboard"]
    code = f"""
import sys
sys.modules.update(dict.fromkeys({extras!r}))
from pathlib import Path
from brushexp.plugin_loading import load_plugins
from brushexp.registry import plugins
load_plugins(Path({str(ROOT / "plugins")!r}))
print([plugin.name for plugin in plugins("order")])"""
    environment = {"PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, env=environment)
    assert done.stderr == ""
    assert "published" in done.stdout
