"""How runs end and go on: signals, steps that give no numbers, files that are others now, or a stranger's."""

import json
import pickle
import signal
from functools import partial
from types import SimpleNamespace

import pytest
import torch
from omegaconf import OmegaConf
from painters import fit, painter_of
from PIL import Image
from program import run, stopped

from brushexp.app import fitting
from brushexp.app.fitting import CHECKPOINT, RECORD, interrupted_run
from brushexp.errors import UserError
from brushexp.painting.painter import DIVERGED
from brushexp.plugins.loss.base import Loss
from brushexp.plugins.loss.pixel import MeanSquaredError
from brushexp.plugins.sampler.patches import Patches
from brushexp.plugins.sampler.whole import Whole
from brushexp.registry import build_named
from brushexp.strokes.catalogue import FIELDS
from brushexp.strokes.storage import load_catalogue


def test_a_run_goes_on_in_its_own_folder_whatever_signals_end_it(tmp_path):
    settings = ["", "threads=1", "frames=3", "steps=900", "report=false"]
    with Image.new("RGB", (40, 30), "navy") as picture:
        picture.paste("gold", (5, 5, 25, 20))
        picture.save(tmp_path / "photo (1).png")
    settings[0] = f"image='{tmp_path}/photo (1).png'"
    folder = tmp_path / "a"
    steps = [stopped(signal.SIGTERM, *settings, output=folder)["steps"]]
    steps += [stopped(number, f"resume={folder}", output=folder)["steps"] for number in (signal.SIGHUP, signal.SIGINT)]
    assert 0 < steps[0] < steps[1] < steps[2] < 900

    picture = (tmp_path / "photo (1).png").read_bytes()
    (tmp_path / "photo (1).png").write_bytes(picture[:-1])
    refused = run(f"resume={folder}", f"output={tmp_path}/b", cwd=tmp_path)
    assert refused.returncode == 1
    assert "is not the file that the run began with" in refused.stdout + refused.stderr
    (tmp_path / "photo (1).png").write_bytes(picture)

    for words in ([f"resume={folder}", f"output={folder}"], [*settings, f"output={tmp_path}/whole"]):
        done = run(*words, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
    assert not (folder / CHECKPOINT).exists()
    found, whole = (load_catalogue(path / "catalogue.h5").strokes for path in (folder, tmp_path / "whole"))
    for name, value in whole.items():
        assert torch.equal(getattr(found, name), value), name
    metrics = json.loads((folder / "metrics.json").read_text())
    assert (metrics["status"], metrics["steps"]) == ("completed", 900)


class Breaking(Loss):
    """The mean squared error, which breaks at its third step."""

    def __init__(self, how: str) -> None:
        super().__init__()
        self.how, self.calls, self.whole = how, 0, MeanSquaredError()

    def forward(self, painting):
        self.calls += torch.is_grad_enabled()
        value = self.whole(painting)
        if self.calls <= 3:  # one of them is the rehearsal
            return value
        if self.how == "gradient":
            return value + 0 * (painting.image - painting.image.detach()).abs().sum().sqrt()  # 0 times infinity
        return value * float(self.how)


@pytest.mark.parametrize("sampler", [Whole, partial(Patches, n_active=9, n_ring=3, patch=20)], ids=["whole", "parts"])
@pytest.mark.parametrize("how", ["nan", "inf", "gradient"])
def test_strokes_stay_as_they_were_before_a_step_that_gives_no_numbers(how, sampler):
    before = painter_of(losses={"broken": MeanSquaredError()}, steps=9, sampler=sampler())
    fit(before, max_steps=2)
    broken = painter_of(losses={"broken": Breaking(how)}, steps=9, sampler=sampler())
    trainer = fit(broken)
    assert (broken.stop, trainer.global_step) == (DIVERGED, 3)
    assert broken.trouble == f"step 3: {'the gradient is not finite' if how == 'gradient' else f'loss=broken is {how}'}"
    for name, value in broken.strokes().items():
        torch.testing.assert_close(value, getattr(before.strokes(), name), atol=1e-6, rtol=1e-6)


@pytest.mark.parametrize(
    "content",
    [b"", b"text", b"\x80\x04.", pickle.dumps({RECORD: 1}), {"state_dict": {}}, [1], {RECORD: {"settings": {}}}],
    ids=["empty", "text", "binary", "pickle", "foreign", "list", "no-task"],
)
def test_what_is_no_checkpoint_is_refused(content, tmp_path, monkeypatch):
    hydra = OmegaConf.create({"overrides": {"task": []}})
    monkeypatch.setattr(fitting, "HydraConfig", SimpleNamespace(get=lambda: hydra))
    if isinstance(content, bytes):
        (tmp_path / CHECKPOINT).write_bytes(content)
    else:
        torch.save(content, tmp_path / CHECKPOINT)
    with pytest.raises(UserError, match=r"checkpoint\.ckpt is (damaged|no checkpoint) .*; start anew"):
        interrupted_run(tmp_path, OmegaConf.create({"task": "paint"}))


def test_a_config_from_a_file_runs_and_looks_up_nothing(tmp_path):
    touch = {"_target_": "pathlib.Path.touch", "_args_": [str(tmp_path / "it")]}
    with pytest.raises(UserError, match="optimizer has an option _target_; nothing below a plugin is built"):
        build_named("optimizer", "torch", {"name": "SGD", "options": {"momentum": touch}})
    assert not (tmp_path / "it").exists()
    with pytest.raises(UserError, match=r"holds an interpolation, \$\{\.\.\.\}; write the value"):
        build_named("optimizer", "torch", {"name": "${oc.env:HOME}"})
    with pytest.raises(UserError, match="is not among the plugins"):
        build_named("optimizer", "pathlib.Path", {})


def test_every_field_is_watched():
    painter = painter_of(n=4)
    assert painter.catalogue.is_finite()
    for name in FIELDS:
        if painter.catalogue.units[name]:
            value = getattr(painter.catalogue, name)
            kept = value.detach().clone()
            with torch.no_grad():
                value.view(-1)[-1] = torch.inf
                assert not painter.catalogue.is_finite(), name
                value.copy_(kept)
