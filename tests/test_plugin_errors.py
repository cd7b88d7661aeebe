"""A message in one line names family, plugin and file of every mistake in a user's plugin."""

import logging
from types import SimpleNamespace

import lightning as L
import pytest
import torch
from omegaconf import OmegaConf
from painters import QUIET, fit, painter_of
from scenes import random_strokes

from brushexp import registry
from brushexp.errors import UserError
from brushexp.plugin_errors import naming_plugins
from brushexp.plugin_loading import load_plugins
from brushexp.plugins.loss.base import PaintedView
from brushexp.registry import PACKAGES, build_named, plugins
from brushexp.runs import trainer as runs_trainer
from brushexp.runs.resume import RunRecord
from brushexp.tasks import paint

SIZE = (8, 12)
TARGET = torch.rand(3, *SIZE, generator=torch.Generator().manual_seed(0))
STROKES = random_strokes(5, SIZE)
STATE = SimpleNamespace(strokes=STROKES)
METHODS = {  # family: contract, its method, a call
    "init": ("Initializer", "__call__", lambda it: it(TARGET, 4, torch.Generator())),
    "renderer": ("Renderer", "forward", lambda it: it(STROKES)),
    "blend": ("Blend", "__call__", lambda it: it(None, torch.arange(5), SIZE, torch.ones(3))),
    "order": ("Order", "depth", lambda it: it.depth(STROKES, None)),
    "loss": ("Loss", "forward", lambda it: it(PaintedView(TARGET, TARGET, STROKES))),
    "density": ("Density", "revise", lambda it: it.revise(STATE)),
    "sampler": ("Sampler", "__call__", lambda it: it(STROKES, SIZE, 0, torch.Generator())),
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
    def {method}(self, *_, **__):
        {body}
"""


def broken_loss(name):
    options = {"family": "loss", "contract": "Loss", "method": "forward", "name": name, "number": 0}
    return HEAD.format("loss") + CLASS.format(body="_[0].picture", **options)


@pytest.fixture
def loaded(tmp_path, monkeypatch, hydra_restore_singletons):
    """Write a plugin into a file and load it; forget it afterwards."""
    monkeypatch.setattr(registry, "_plugins", dict(registry._plugins))
    monkeypatch.setenv("BRUSHEXP_PLUGINS", str(tmp_path))

    def load(text, name):
        (tmp_path / f"{name}.py").write_text(text)
        load_plugins(tmp_path)

    return load


@pytest.mark.parametrize("family", METHODS)
def test_what_a_plugin_does_wrong_is_told_with_its_name_and_file(loaded, family):
    contract, method, call = METHODS[family]
    names = [f"bad_{family}_{number}" for number in range(len(WRONG))]
    text, about = HEAD.format(PACKAGES[family]), {"family": family, "contract": contract, "method": method}
    for number, (name, (body, _)) in enumerate(zip(names, WRONG, strict=True)):
        text += CLASS.format(number=number, name=name, body=body, **about)
    loaded(text, f"bad_{family}")
    for name, (body, message) in zip(names, WRONG, strict=True):
        if (family, body) == ("density", "return None"):
            continue  # no change is an answer
        pattern = rf"^{family}={name} \(.*bad_{family}\.py(\): {method}|,) {message}.*correct the plugin"
        with pytest.raises(UserError, match=pattern) as error, naming_plugins(plugins()):
            call(build_named(family, name, {}))
        assert "\n" not in str(error.value)


@pytest.mark.parametrize(("text", "message"), [
    ("@register('loss', 'half')\nclass Half(Loss): ...", r"loss=half \(.*half\.py\): class Half lacks forward"),
    ("@register('loss', 'half')\nclass Half: ...", r"class Half lacks a base class of brushexp\.plugins\.loss\.base"),
    ("import sys; sys.exit(3)", r"half\.py cannot be loaded: SystemExit: 3; correct it or move it away"),
])  # fmt: skip
def test_half_a_plugin_is_refused_when_it_is_loaded(loaded, text, message):
    with pytest.raises(UserError, match=message):
        loaded(f"from brushexp.plugins.loss.base import Loss\nfrom brushexp.registry import register\n{text}\n", "half")


def test_a_plugin_that_fails_where_a_run_goes_on_is_no_fault_of_the_checkpoint(loaded, tmp_path):
    loaded(broken_loss("trips"), "trips")
    works = {"trips": build_named("loss", "mse", {})}  # as it did when the run began
    fit(painter_of(n=4, steps=4, losses=works), max_steps=2).save_checkpoint(tmp_path / "c.ckpt")
    painter = painter_of(n=4, steps=4, losses={"trips": build_named("loss", "trips", {})})
    trainer = L.Trainer(**QUIET, callbacks=[RunRecord(OmegaConf.create({"task": "paint"}), tmp_path)])
    with pytest.raises(UserError, match=r"loss=trips .*AttributeError"), naming_plugins(plugins()):
        runs_trainer.fit(trainer, painter, checkpoint=tmp_path / "c.ckpt")


def test_a_painting_tells_of_the_plugin_and_its_log_has_the_traceback(loaded, run_task, tmp_path):
    loaded(broken_loss("falls"), "falls")
    handler = logging.FileHandler(tmp_path / "run.log")
    logging.getLogger().addHandler(handler)
    try:
        with (
            pytest.raises(UserError, match=r"loss=falls .*falls\.py, line \d+\): AttributeError"),
            naming_plugins(plugins()),
        ):
            run_task(paint, "image=astronaut", "resolution=16", "loss=[falls]", "steps=2", "threads=1", "frames=0")
    finally:
        logging.getLogger().removeHandler(handler)
        handler.close()
    assert "in training_step" in (tmp_path / "run.log").read_text()
