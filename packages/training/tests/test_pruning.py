"""Test that pruning removes idle channels first, and that the remaining network can be loaded and trained."""

import json
import sys
from pathlib import Path

import pytest
import torch
from brushexp_training.renderers.inverse_vgg import (
    InverseVGG,
)
from brushexp_training.renderers.pruning import MULTIPLE, prune
from brushexp_training.stroke_sets.datamodule import StrokeBatch
from brushexp_training.stroke_sets.dataset import Origin
from brushexp_training.stroke_sets.writer import simulate_set
from brushexp_training.tasks import prune as task
from brushexp_training.tasks import train
from refusals import refuses
from sweeps import read_csv
from test_checkpoints import PRUNED, smallest

from brushexp.plugins.renderer.analytic import Analytic
from brushexp.plugins.renderer.base import RENDERERS, window_pictures
from brushexp.registry import build_named
from brushexp.strokes.prior import parameters_of, sample_prior
from brushexp.system.callbacks import TimedCheckpoint
from brushexp.system.checkpoint import weights_hash


def batch(n: int = 6) -> StrokeBatch:
    parameters = parameters_of(sample_prior(n))
    with torch.no_grad():
        return StrokeBatch(parameters, window_pictures(Analytic(), parameters, 64), torch.arange(n))


@torch.no_grad()
def silence_every_other_channel(renderer: InverseVGG) -> None:
    """Set the weights of every other channel to 0 in all layers but the last, so that these channels output 0."""
    for layer in renderer.dense:
        layer.weight[::2], layer.bias[::2] = 0, 0
    first = renderer.first
    first.weight.view(16, first.channels, -1)[:, ::2] = 0
    first.bias.view(16, first.channels)[:, ::2] = 0
    for layer in renderer.convolving:
        layer.convolution.weight[::2], layer.convolution.bias[::2] = 0, 0
        if layer.coordinates is not None:
            layer.coordinates.weight[::2] = 0
        if layer.strength is not None:
            layer.strength[::2] = 0


@pytest.mark.parametrize("options", [
    {},
    {"upsampling": "bilinear", "coordconv": "window"},
    {"coordconv": "none", "tint": False, "noise": 1.0},
    {"normalisation": "batch"},
])  # fmt: skip
def test_channels_that_do_nothing_are_the_ones_to_go(options):
    renderer = smallest(activation="elu", **options)  # relu might silence other channels
    silence_every_other_channel(renderer)
    before = renderer.state_dict()["last.weight"].clone()
    pruned = prune(renderer, 0.5, [batch()])
    assert pruned.widths == [width // 2 for width in renderer.widths]
    with torch.no_grad():
        inputs = parameters_of(sample_prior(5, seed=3))
        torch.testing.assert_close(pruned.draw(inputs), renderer.draw(inputs), rtol=1e-4, atol=1e-5)
    assert torch.equal(renderer.last.weight, before)


def test_widths_are_multiples_and_shrink_with_the_ratio():
    renderer = smallest()
    numbers = []
    for ratio in (0.0, 0.25, 0.5, 0.9):
        pruned = prune(renderer, ratio, [batch(2)])
        assert all(width % MULTIPLE == 0 and width >= MULTIPLE for width in pruned.widths)
        assert pruned.draw(batch(2).parameters).shape == (2, 4, 64, 64)
        numbers.append(sum(weight.numel() for weight in pruned.parameters()))
        assert ratio or weights_hash(pruned) == weights_hash(renderer)
    assert numbers == sorted(numbers, reverse=True)
    assert numbers[3] < 0.3 * numbers[0]
    again = prune(pruned, 0.5, [batch(2)])
    assert all(b <= a for a, b in zip(pruned.widths, again.widths, strict=True))
    assert all(weight.requires_grad and weight.grad is None for weight in again.parameters())
    again.draw(batch(2).parameters).square().mean().backward()
    assert all(bool(weight.grad.isfinite().all()) for weight in again.parameters())


def test_a_pruned_checkpoint_loads_by_its_name_alone(tmp_path):
    pruned = prune(smallest(), 0.5, [batch(2)]).eval()
    path = tmp_path / "pruned.safetensors"
    RENDERERS.save(path, "inverse_vgg", pruned, {"options": {**PRUNED, "channels": pruned.widths}})
    again = smallest(checkpoint=str(path))
    assert again.widths == pruned.widths != smallest().widths
    with torch.no_grad():
        assert torch.equal(again.draw(batch().parameters), pruned.draw(batch().parameters))
    assert weights_hash(smallest(checkpoint=str(path), channels=pruned.widths)) == weights_hash(pruned)
    words = r"was trained with renderer.channels=\[16, .*, not \[32, "
    refuses(words, smallest, checkpoint=str(path), channels=smallest().widths)


@pytest.mark.parametrize("channels", [[8], [8] * 30, [0] * 9, [8] * 8 + ["x"]])
def test_channels_of_a_file_that_do_not_fit_are_refused(channels, tmp_path):
    path = tmp_path / "pruned.safetensors"
    RENDERERS.save(path, "inverse_vgg", smallest(), {"options": {**PRUNED, "channels": channels}})
    refuses(r"renderer.channels=\[.*\] are not 9 widths", smallest, checkpoint=str(path))
    assert smallest(channels=[8] * 9).widths == [8] * 9


@pytest.mark.parametrize(("key", "value", "message"), [
    ("normalisation", "group", "group or instance mixes channels"),
    ("normalisation", "instance", "group or instance mixes channels"),
    ("upsampling", "pixel_shuffle", "pixel_shuffle ties channels to pixels"),
])  # fmt: skip
def test_networks_whose_channels_cannot_be_told_apart_are_refused(key, value, message, monkeypatch):
    refuses(f"renderer.{key}={message}", prune, smallest(**{key: value}), 0.5, [batch(2)])
    monkeypatch.setitem(sys.modules, "torch_pruning", None)
    refuses(r"task=prune needs torch-pruning; pip install 'brushexp\[prune\]'", prune, smallest(), 0.5, [])


@pytest.fixture
def run(tmp_path, run_task):
    """Return a function that runs the task in this process, on strokes of the simplest engine."""
    strokes, trained = tmp_path / "strokes", tmp_path / "trained.safetensors"
    simulate_set(strokes, build_named("engine", "disc", {}), Origin("disc", {"window": 64}, 64), 0, 350)
    origin = {"engine": "disc", "engine_config": {"window": 64}, "window": 64}
    RENDERERS.save(trained, "inverse_vgg", smallest(), {"options": PRUNED, "data": origin})
    chosen = {"width": 16, "widest": 32, "dense": "[32,16]", "subpixel": 4, "checkpoint": trained}
    common = ["task=prune", "device=cpu", f"data={strokes}", "epochs=1", "limit=64", "n=8"]
    common += ["trainer.precision=32-true", *(f"renderer.{key}={value}" for key, value in chosen.items())]
    return lambda *overrides: run_task(task, *common, *overrides)


def test_strokes_in_windows_of_another_size_are_refused(run, tmp_path):
    simulate_set(
        tmp_path / "small", build_named("engine", "disc", {"window": 32}), Origin("disc", {"window": 32}, 32), 0, 33
    )
    words = r"renderer.window=64, but the strokes have 32 pixels"
    refuses(words, run, "ratios=[0.5]", f"data={tmp_path / 'small'}", "other_data=true")


def test_an_interrupted_run_recommends_nothing_that_there_is_not(run, tmp_path, monkeypatch):
    def stop(self, trainer, pl_module, *_):
        if pl_module.global_step == 1:
            self.pressed.set()

    monkeypatch.setattr(TimedCheckpoint, "on_train_batch_start", stop)
    with pytest.raises(KeyboardInterrupt) as caught:
        run("ratios=[0.5]", "batch_size=16")
    assert caught.value.args == (), "only the whole run reports results, not its parts"
    assert not list(tmp_path.rglob("checkpoint.ckpt"))
    assert smallest(checkpoint=str(tmp_path / "inverse_vgg_50.safetensors")).widths != smallest().widths


def test_a_run_leaves_a_table_and_renderers_that_paint_and_train(run, run_task, tmp_path):
    metrics = run("ratios=[0,0.5]")
    assert (metrics["status"], metrics["n"]) == ("completed", 8)
    rows = json.loads((tmp_path / "metrics.json").read_text())["pruned"]
    assert [float(row["ratio"]) for row in read_csv(tmp_path / "pruning.csv")] == [0, 0.5]
    assert len((tmp_path / "pruning.md").read_text().splitlines()) == 4
    assert (tmp_path / "strokes.png").is_file()
    assert not list(tmp_path.rglob("checkpoint.ckpt"))
    assert rows[1]["parameters"] < 0.5 * rows[0]["parameters"]
    assert rows[1]["file_mb"] < rows[0]["file_mb"]
    assert rows[1]["l2"] < rows[1]["l2_before"]
    path = tmp_path / "inverse_vgg_50.safetensors"
    again = smallest(checkpoint=str(path))
    assert sum(weight.numel() for weight in again.parameters()) == rows[1]["parameters"]
    taught = ["task=train", "device=cpu", f"data={tmp_path / 'strokes'}", "epochs=1", "limit=64", "fid=0"]
    chosen = {"width": 16, "widest": 32, "dense": "[32,16]", "subpixel": 4, "checkpoint": path}
    words = (f"renderer.{key}={value}" for key, value in chosen.items())
    run_task(train, *taught, "renderer=inverse_vgg", *words)
    assert smallest(checkpoint=str(path.with_stem("inverse_vgg"))).widths == again.widths != smallest().widths
    recipe = json.loads(path.with_suffix(".json").read_text())
    assert recipe["training"]["pruned"] == 0.5
    assert Path(recipe["training"]["started_from"]).name == "trained.safetensors"
