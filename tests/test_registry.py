"""Tests that registered classes become typed Hydra choices, and that plugins load from three kinds of places."""

import logging
import os
import re
import subprocess
import sys
from types import ModuleType, SimpleNamespace

import lightning as L
import pytest
import torch
from hydra.core.config_store import ConfigStore
from omegaconf import OmegaConf
from painters import QUIET, fit, painter_of
from program import ROOT, publish, run
from refusals import refuses
from scenes import random_strokes

from brushexp.errors import UserError
from brushexp.painting.components import build_components
from brushexp.plugins.density.strays import Strays
from brushexp.plugins.loss.base import PaintedView
from brushexp.plugins.paper.base import Rows
from brushexp.registry import FOLDERS, build, build_named, plugin, plugins, register
from brushexp.registry.blame import naming_plugins
from brushexp.registry.loading import load_plugins
from brushexp.registry.options import structured_config
from brushexp.runs import trainer as runs_trainer
from brushexp.runs.resume import RunRecord
from brushexp.tasks import paint

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
def clean(hydra_restore_singletons):
    """When a test ends, remove the plugins that it registered."""
    before = set(plugin._members)
    yield
    for key in set(plugin._members) - before:
        del plugin._members[key]
        plugin._classes.pop(key, None)


@pytest.mark.usefixtures("clean")
def test_plugins_in_folders_of_the_environment_are_found_and_a_taken_name_and_an_unknown_family_refused(
    tmp_path, monkeypatch
):
    class Mse:
        def __init__(self, *, weight: float = 1.0) -> None: ...

    refuses(r"loss=mse is taken by brushexp\.plugins\.loss\.mse", register("loss", "mse"), Mse)
    refuses("unknown plugin family 'losses'; choose one of painter, palette, init, ", register, "losses", "x")
    text = PLUGIN.format(name="upside").replace("-strokes", "SIGN * strokes")
    (tmp_path / "upside.py").write_text(f"from brushexp_plugins._shared import SIGN\n{text}")
    (tmp_path / "_shared.py").write_text("SIGN = -1")
    (tmp_path / "_helper.py").write_text("this is no plugin")
    monkeypatch.setenv("BRUSHEXP_PLUGINS", str(tmp_path))
    assert "upside" in load_plugins(ROOT / "plugins")
    plugin = next(p for p in plugins("order") if p.name == "upside")
    assert plugin.summary == "Upside down."
    assert build_named("order", "upside", {"every": 5}).every == 5


def test_options_are_typed_run_time_arguments_are_none_and_defaults_are_not_shared(config):
    class Thing:
        def __init__(self, target, *, rows: int = 8, rate: float) -> None: ...

    class Untyped:
        def __init__(self, *, rows=8) -> None: ...

    assert list(structured_config(Thing, "loss/thing").__dataclass_fields__) == ["_target_", "rows", "rate"]
    with pytest.raises(TypeError, match="give 'rows' a type"):
        structured_config(Untyped, "loss/untyped")
    first = config("optimizer=torch").optimizer
    first.units["position"] = 99.0
    assert config("optimizer=torch").optimizer.units["position"] != 99.0


def test_only_registered_classes_are_built_those_of_earlier_versions_too_and_options_are_checked():
    with pytest.raises(UserError, match=r"os\.system is not a registered plugin"):
        build(OmegaConf.create({"_target_": "os.system", "command": "true"}))
    assert build_named("renderer", "analytic", {"soft": 2.0}).soft == 2.0
    refuses("does not accept these options", build_named, "renderer", "analytic", {"soft": "wide"})
    refuses(r"renderer=cubist is not among the plugins here \(analytic", build_named, "renderer", "cubist", {})
    node = OmegaConf.create({"_target_": "brushexp.plugins.density.strays.Strays", "after": 0.5})
    assert type(build(node)) is Strays
    with pytest.raises(UserError, match="is not a registered plugin"):
        build(OmegaConf.create({"_target_": "brushexp.plugins.density.strays.Other"}))


@pytest.mark.usefixtures("clean")
@pytest.mark.parametrize(("text", "message"), [
    ("def broken(:\n", r"broken\.py, line 1: .*; correct it or move it away"),
    ("1 / 0\n", r"broken\.py cannot be loaded: ZeroDivisionError: division by zero"),
    ("import sys; sys.exit(3)", r"broken\.py cannot be loaded: SystemExit: 3; correct it or move it away"),
])  # fmt: skip
def test_a_broken_file_is_told_and_left_out_and_told_again_where_its_name_is_missed(
    tmp_path, monkeypatch, caplog, config, text, message
):
    (tmp_path / "broken.py").write_text(text)
    good = f"good_{len(text)}"  # a file of the same name would not be imported again
    (tmp_path / f"{good}.py").write_text(PLUGIN.format(name=good))
    monkeypatch.setenv("BRUSHEXP_PLUGINS", str(tmp_path))
    assert good in load_plugins(ROOT / "plugins")
    assert re.search(message, caplog.text)
    assert config(f"order={good}", "loss=mse").order.every == 3
    monkeypatch.setenv("BRUSHEXP_PLUGINS", "")
    found = run("loss=broken", "image=coffee", cwd=tmp_path, BRUSHEXP_PLUGINS=str(tmp_path))
    assert found.returncode == 1
    assert re.search(rf"loss=broken does not exist; .*{message}", found.stderr)


def test_two_files_of_one_name_and_a_folder_that_is_not_there_stop_the_program(tmp_path, monkeypatch):
    (tmp_path / "scatter.py").write_text("")
    monkeypatch.setenv("BRUSHEXP_PLUGINS", str(tmp_path))
    refuses("have the same name; rename one", load_plugins, ROOT / "plugins")
    monkeypatch.setenv("BRUSHEXP_PLUGINS", "/nowhere/at/all")
    refuses("BRUSHEXP_PLUGINS names /nowhere/at/all, which is not a folder", load_plugins, ROOT / "plugins")


def test_published_plugins_are_found_and_all_load_without_the_extras(tmp_path):
    (tmp_path / "published_order.py").write_text(PLUGIN.format(name="published"))
    publish(tmp_path, "published", "1.0", {"order.published": "published_order"})
    extras = ["av", "joblib", "torch_pruning", "pytorch_optimizer", "vpype", "vpype_cli", "shapely", "tensorboard"]
    code = f"""
import sys
sys.modules.update(dict.fromkeys({extras!r}))
from pathlib import Path
from brushexp.registry.loading import load_plugins
from brushexp.registry import plugins
load_plugins(Path({str(ROOT / "plugins")!r}))
print([plugin.name for plugin in plugins("order")])"""
    environment = {"PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, env=environment)
    assert done.stderr == ""
    assert "published" in done.stdout


SIZE = (8, 12)
TARGET = torch.rand(3, *SIZE, generator=torch.Generator().manual_seed(0))
STROKES = random_strokes(5, SIZE)
STATE = SimpleNamespace(strokes=STROKES)
METHODS = {  # family: contract, its method, a call
    "palette": ("Palette", "__call__", lambda it: it(TARGET)),
    "paper": ("Paper", "relief", lambda it: it.relief(Rows(0, 8, SIZE))),
    "init": ("Initializer", "__call__", lambda it: it(TARGET, 4, torch.Generator())),
    "renderer": ("Renderer", "forward", lambda it: it(STROKES)),
    "blend": ("Blend", "__call__", lambda it: it(None, torch.arange(5), SIZE, torch.ones(3))),
    "order": ("Order", "depth", lambda it: it.depth(STROKES, None)),
    "loss": ("Loss", "forward", lambda it: it(PaintedView(TARGET, TARGET, STROKES))),
    "density": ("Density", "revise", lambda it: it.revise(STATE)),
    "sampler": ("Sampler", "__call__", lambda it: it(STROKES, SIZE, 0, torch.Generator())),
    "change": ("Change", "begin", lambda it: it.begin(STROKES, None)),
    "engine": ("Engine", "__call__", lambda it: it(torch.zeros(2, 10), seed=0)),
    "color": ("ColorSpace", "decode", lambda it: it.decode(TARGET)),
    "painter": ("Painter", "__call__", lambda it: it(None)),
    "callbacks": ("Callback", "open", lambda it: it.open(None)),
    "to": ("Exporter", "write", lambda it: it.write(None, None)),
}
WRONG = [  # bodies of such a method, and messages
    ("return None", "returns None, not "),
    ("return 1.5", "returns 1.5, not "),
    ("return torch.ones(2, 7)", r"returns .*\(2, 7\) of torch.float32, not "),
    ("return 1j * torch.ones(5)", r"returns .*\(5,\) of torch.complex64, not "),
    ("return 'text'", "returns 'text', not "),
    ("raise ValueError('no\\nmore')", r"line \d+\): ValueError: no; "),
    ("return 1 / 0", r"line \d+\): ZeroDivisionError: division by zero; "),
    ("sys.exit(0)", r"line \d+\): ends the program \(exit code 0\); "),
]
HEAD = "import sys\nimport torch\nfrom brushexp.plugins.{0}.base import *\nfrom brushexp.registry import register\n"
CLASS = """
@register("{family}", "{name}")
class Bad{number}({contract}):
    def encode(self, color):  # without which a colour space is none
        return color
    def cover(self, flat, bare, rows):  # and a paper
        return flat
    def {method}(self, *_, **__):
        {body}
"""


def broken_loss(name):
    options = {"family": "loss", "contract": "Loss", "method": "forward", "name": name, "number": 0}
    return HEAD.format("loss") + CLASS.format(body="_[0].picture", **options)


@pytest.fixture
def loaded(tmp_path, monkeypatch, clean):
    """Return a function that writes a plugin file and loads it; the plugin is removed after the test."""
    monkeypatch.setenv("BRUSHEXP_PLUGINS", str(tmp_path))

    def load(text, name):
        (tmp_path / f"{name}.py").write_text(text)
        load_plugins(tmp_path)

    return load


def test_an_option_without_a_default_is_asked_for(loaded):
    body = "def __init__(self, *, power: float): ...\n    def forward(self, view): ..."
    loaded(f"{HEAD.format('loss')}\n@register('loss', 'asks')\nclass Asks(Loss):\n    {body}\n", "asks")
    refuses(
        r"^loss=asks needs loss\.asks\.power, which has no default; type loss\.asks\.power=",
        build_named,
        "loss",
        "asks",
        {},
    )


def test_an_attribute_that_a_plugin_lacks_is_named(loaded):
    text = f"{HEAD.format('order')}\n@register('order', 'lacks')\nclass Lacks(Order):\n    def depth(self, *_): ..."
    loaded(text, "lacks")
    message = r"^order=lacks \(.*lacks\.py\): it has no attribute every; correct the plugin$"
    with pytest.raises(UserError, match=message), naming_plugins():
        build_named("order", "lacks", {}).every  # noqa: B018


def test_colours_that_are_none_are_no_target(loaded):
    text, body = HEAD.format("palette"), "def __call__(self, picture): return picture * float('nan')"
    loaded(f"{text}\n@register('palette', 'mad')\nclass Mad(Palette):\n    {body}", "mad")
    refuses("__call__ returns a picture with non-finite numbers", build_named("palette", "mad", {}), TARGET)


@pytest.mark.parametrize("family", METHODS)
def test_what_a_plugin_does_wrong_is_told_with_its_name_and_file(loaded, family):
    contract, method, call = METHODS[family]
    names = [f"bad_{family}_{number}" for number in range(len(WRONG))]
    text, about = HEAD.format(FOLDERS[family]), {"family": family, "contract": contract, "method": method}
    for number, (name, (body, _)) in enumerate(zip(names, WRONG, strict=True)):
        text += CLASS.format(number=number, name=name, body=body, **about)
    loaded(text, f"bad_{family}")
    for name, (body, message) in zip(names, WRONG, strict=True):
        if (family, body) == ("density", "return None"):
            continue  # for density, None is valid: no change
        pattern = rf"^{family}={name} \(.*bad_{family}\.py(\): {method}|,) {message}.*correct the plugin"
        with pytest.raises(UserError, match=pattern) as error, naming_plugins():
            call(build_named(family, name, {}))
        assert "\n" not in str(error.value)


@pytest.mark.parametrize(("text", "message"), [
    ("@register('loss', 'half')\nclass Half(Loss): ...", r"loss=half \(.*half\.py\): class Half lacks forward"),
    ("@register('loss', 'half')\nclass Half: ...", r"class Half lacks a base class of brushexp\.plugins\.loss\.base"),
    ("@register('loss', 'half')\nclass Half(Loss):\n    def forward(self, picture, target): ...",
     r"loss=half \(.*half\.py\): forward\(self, picture, target\) is called with \(self, view\); correct the plugin"),
    ("from brushexp.plugins.metric.base import Metric\n@register('metric', 'half')\nclass Half(Metric):\n"
     "    def __call__(self, comparison): ...", "class Half lacks title, higher_is_better$"),
    ("@register('loss', 'half')\ndef half(view): ...", "loss=half is <function half .*>, not a class; write one"),
])  # fmt: skip
def test_half_a_plugin_is_refused_when_it_is_loaded(loaded, caplog, text, message):
    loaded(f"from brushexp.plugins.loss.base import Loss\nfrom brushexp.registry import register\n{text}\n", "half")
    (record,) = caplog.records
    assert re.search(message, record.getMessage().removesuffix("; it is left out"))


def test_a_plugin_that_fails_is_told_in_a_painting_and_where_one_goes_on_with_the_traceback_in_the_log(
    loaded, tmp_path, run_task
):
    loaded(broken_loss("trips"), "trips")
    works = {"trips": build_named("loss", "mse", {})}  # so that the run starts without the failure
    fit(painter_of(n=4, steps=4, losses=works), max_steps=2).save_checkpoint(tmp_path / "c.ckpt")
    painter = painter_of(n=4, steps=4, losses={"trips": build_named("loss", "trips", {})})
    trainer = L.Trainer(**QUIET, callbacks=[RunRecord(OmegaConf.create({"task": "paint"}), tmp_path)])
    with pytest.raises(UserError, match=r"loss=trips .*AttributeError"), naming_plugins():
        runs_trainer.fit(trainer, painter, checkpoint=tmp_path / "c.ckpt")
    loaded(broken_loss("falls"), "falls")
    handler = logging.FileHandler(tmp_path / "run.log")
    logging.getLogger().addHandler(handler)
    try:
        with (
            pytest.raises(UserError, match=r"loss=falls .*falls\.py, line \d+\): AttributeError"),
            naming_plugins(),
        ):
            run_task(paint, "image=astronaut", "resolution=16", "loss=[falls]", "steps=2", "threads=1", "frames=0")
    finally:
        logging.getLogger().removeHandler(handler)
        handler.close()
    assert "in weighted_sum" in (tmp_path / "run.log").read_text()


SEVERAL = """
import lightning as L
from brushexp.contracts import register
from brushexp.contracts.families import Callback, Palette
from brushexp.contracts.members import TorchOptim

@register("palette", "{name}")
class Plain(Palette):
    def __call__(self, picture):
        return picture

class Hook(L.Callback):
    def on_train_batch_end(self, *_, **__):
        half(0)

def half(number):
    return 1 / number

@register("callbacks", "{name}")
class Hooked(Callback):
    def open(self, folder):
        return Hook()

@register("optimizer", "{name}")
class Stuck(TorchOptim):
    @property
    def units(self):
        return {{"nonsense": 1.0}}
"""


def test_of_several_plugins_in_a_file_the_one_is_blamed_whose_class_names_what_failed(loaded):
    loaded(SEVERAL.format(name="several"), "several")
    hook = build_named("callbacks", "several", {}).open(None)
    with (
        pytest.raises(UserError, match=r"^callbacks=several \(.*several\.py, line 17\): ZeroDivisionError"),
        naming_plugins(),
    ):
        hook.on_train_batch_end()
    with (
        pytest.raises(UserError, match=r"^optimizer=several \(.*several\.py\): AttributeError: .* has no setter"),
        naming_plugins(),
    ):
        build_named("optimizer", "several", {})


def test_units_of_no_field_are_refused_with_the_name_of_the_optimizer(config):
    words = ("+optimizer.units.nonsense=1",)
    refuses("^optimizer=torch: no stroke field is called 'nonsense'", build_components, config(*words))


def test_a_loss_on_another_device_is_named(loaded):
    text = HEAD.format("loss") + CLASS.format(
        family="loss", contract="Loss", method="forward", name="far", number=0,
        body="return _[0].image.mean().to('meta')",
    )  # fmt: skip
    loaded(text, "far")
    view = PaintedView(TARGET, TARGET, STROKES)
    refuses(
        r"^loss=far \(.*far\.py\): forward returns a tensor on meta, not on cpu", build_named("loss", "far", {}), view
    )


def test_a_file_that_fails_half_way_leaves_no_plugin_behind(loaded, caplog):
    loaded(PLUGIN.format(name="early") + "\n1 / 0\n", "early")
    assert "cannot be loaded: ZeroDivisionError" in caplog.text
    assert "early" not in [plugin.name for plugin in plugins("order")]
    assert "early.yaml" not in ConfigStore.instance().repo["order"]


def test_a_class_of_a_notebook_is_named_by_its_module(clean, monkeypatch):
    cells = ModuleType("cells")  # has no file
    monkeypatch.setitem(sys.modules, "cells", cells)
    exec(PLUGIN.format(name="cell"), vars(cells))
    assert "cell" in [plugin.name for plugin in plugins("order")]
    wrong = PLUGIN.format(name="cell_2").replace("-strokes.opacity", "1.5")
    exec(wrong, vars(cells))
    refuses(r"^order=cell_2 \(cells\): depth returns 1\.5", build_named("order", "cell_2", {}).depth, STROKES, None)


PAINT = ("image=chelsea", "resolution=24", "strokes=9", "steps=1", "frames=0", "report=false", "output=x")


@pytest.fixture
def unfinished(tmp_path):
    """Make a folder that holds an unfinished plugin and an unfinished config."""
    for name, text in (("plugins/zz.py", "def broken(:\n"), ("conf/look/half.yaml", "a: [\n")):
        (tmp_path / name).parent.mkdir(parents=True)
        (tmp_path / name).write_text(text)
    return tmp_path


@pytest.mark.parametrize("words", [
    ["--help"],
    ["loss=", "--help"],
    PAINT,
    ["-m", *PAINT, "seed=0,1"],
    ["-m", *PAINT, "seed=0,1", "hydra/launcher=processes", "hydra.launcher.n_jobs=2"],
], ids=["help", "help of a family", "run", "sweep", "processes"])  # fmt: skip
def test_unfinished_files_that_nobody_chose_are_one_warning_each(unfinished, words):
    done = run(*words, cwd=unfinished, BRUSHEXP_PLUGINS="")
    assert done.returncode == 0, done.stderr
    for name in ("zz.py", "half.yaml"):
        assert (done.stdout + done.stderr).count(name) == 1, done.stderr


def test_run_py_warns_of_an_unfinished_file_as_the_program_does(unfinished):
    command = [sys.executable, str(ROOT / "run.py"), "--help"]
    done = subprocess.run(command, cwd=unfinished, capture_output=True, text=True, check=True)
    assert done.stderr.count("zz.py, line 1: invalid syntax; correct it or move it away; it is left out") == 1
