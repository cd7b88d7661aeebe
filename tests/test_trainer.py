"""Training renderers: it learns, it averages, it resumes exactly, and it says what it measures."""

import json
import math
import signal
import time
from copy import deepcopy
from functools import partial
from pathlib import Path

import lightning as L
import pytest
import torch
from program import Program, run
from test_dataset import write
from torch import nn
from torch.utils.data import DataLoader

from brushexp.app.tasks import train
from brushexp.errors import UserError
from brushexp.plugins.renderer.analytic import Analytic
from brushexp.plugins.renderer.base import PatchRenderer, window_pictures
from brushexp.plugins.renderer.weights_file import read_recipe
from brushexp.registry import build_named
from brushexp.strokes.prior import parameters_of, sample_prior
from brushexp.system.checkpoint import weights_hash
from brushexp.training.datamodule import StrokeBatch, StrokeLoader
from brushexp.training.evaluation import Errors, decibels, errors_of, premultiplied, squared_error
from brushexp.training.progress import Checkpoints, sheet_of_pairs
from brushexp.training.trainer import RendererTrainer, Training, balanced

SIDE = 16
TINY = ("renderer.width=4", "renderer.widest=8", "renderer.dense=[16]")


class Small(PatchRenderer):
    """Draws 16 x 16 pixels with two layers and a batch norm, so that there is a buffer to average."""

    window = SIDE

    def __init__(self) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            nn.Linear(10, 32), nn.BatchNorm1d(32), nn.ReLU(), nn.Linear(32, 4 * SIDE * SIDE), nn.Sigmoid()
        )

    def draw(self, parameters):
        return self.layers(parameters).reshape(-1, 4, SIDE, SIDE)


def strokes(n: int, side: int = SIDE, first: int = 0) -> StrokeBatch:
    """Analytic strokes as training data."""
    parameters = parameters_of(sample_prior(n, 0, first))
    with torch.no_grad():
        return StrokeBatch(parameters, window_pictures(Analytic(soft=1.0), parameters, side), torch.arange(n) + first)


class Strokes(L.LightningDataModule):
    """A few analytic strokes, in an order that the epoch decides."""

    def __init__(self, n: int = 32, batch: int = 8) -> None:
        super().__init__()
        self.known, self.batch = strokes(n), batch

    def batches(self, epoch, first):
        order = torch.randperm(len(self.known.number), generator=torch.Generator().manual_seed(epoch))
        for part in order.split(self.batch)[first:]:
            yield StrokeBatch(*(value[part] for value in self.known))

    def train_dataloader(self):
        return StrokeLoader(self.batches, -(-len(self.known.number) // self.batch), 0)

    def val_dataloader(self):
        return DataLoader([strokes(5, first=100)], batch_size=None)


def fit(module, data, *callbacks, resume=None, epochs=-1):
    trainer = L.Trainer(
        accelerator="cpu",
        max_epochs=epochs,
        logger=False,
        callbacks=list(callbacks),
        enable_checkpointing=False,
        enable_progress_bar=False,
        enable_model_summary=False,
        num_sanity_val_steps=0,
    )
    trainer.fit(module, data, ckpt_path=resume)
    return trainer


@torch.no_grad()
def error(module: RendererTrainer, data: Strokes) -> float:
    """L2 of the averaged weights on the training strokes."""
    renderer = deepcopy(module.averaged).eval()
    return float(squared_error(window_pictures(renderer, data.known.parameters, SIDE), data.known.images))


class StopAt(L.Callback):
    """Presses Ctrl-C, so to say, after so many steps."""

    def __init__(self, step):
        self.step = step

    def on_train_batch_end(self, trainer, module, *_):
        if module.step == self.step:
            module.stop = "interrupted"


def test_a_few_strokes_are_learned_and_validated():
    module = RendererTrainer(Small(), SIDE, Training(lr=0.01, epochs=60, ema=0.9))
    data = Strokes(8)
    before = error(module, data)
    fit(module, data, epochs=60)
    assert error(module, data) < 0.2 * before
    assert module.step == module.judged == 60
    assert set(module.figures) == {"l2", "psnr_alpha", "psnr_color"}
    assert module.examples[0].shape == (5, 4, SIDE, SIDE)


@pytest.mark.parametrize("step", [1, 5, 8, 11])
@pytest.mark.parametrize("critic", [False, True])
def test_a_resumed_training_ends_with_the_same_weights(tmp_path, step, critic):
    # Four steps an epoch: in the middle of the first one, right after one, and at the end of one.
    plan = Training(epochs=3, critic=critic, critic_width=4)

    def fresh():
        torch.manual_seed(3)
        return RendererTrainer(Small(), SIDE, plan)

    whole = fresh()
    fit(whole, Strokes(), epochs=3)
    halved = fresh()
    path = tmp_path / "checkpoint.ckpt"
    fit(halved, Strokes(), StopAt(step), Checkpoints(path, None), epochs=3)
    assert step <= halved.step < 12
    torch.manual_seed(99)
    resumed = RendererTrainer(Small(), SIDE, plan)
    fit(resumed, Strokes(), Checkpoints(path, None), resume=str(path), epochs=3)
    assert resumed.step == whole.step == 12
    expected, found = whole.state_dict(), resumed.state_dict()
    assert expected.keys() == found.keys()
    assert all(torch.equal(expected[name], found[name]) for name in expected)
    assert resumed.figures == whole.figures


def test_training_ends_when_its_minutes_are_over_and_validates_what_it_has():
    module = RendererTrainer(Small(), SIDE, Training(minutes=0.01))
    begin = time.monotonic()
    fit(module, Strokes())
    assert time.monotonic() - begin < 20
    assert module.seconds >= 0.6
    assert module.figures


def test_the_rate_rises_and_falls_to_its_end():
    module = RendererTrainer(Small(), SIDE, Training(lr=1.0, epochs=250))
    rates = []

    class Watch(L.Callback):
        def on_train_batch_end(self, trainer, module, *_):
            rates.append(module.optimizers(use_pl_optimizer=False).param_groups[0]["lr"])

    fit(module, Strokes(8), Watch(), epochs=250)
    peak = rates.index(max(rates))
    assert rates[0] < 0.01
    assert 0.9 < max(rates) <= 1
    assert rates[: peak + 1] == sorted(rates[: peak + 1])
    assert rates[peak:] == sorted(rates[peak:], reverse=True)
    assert rates[-1] < 0.011


def test_averaged_weights_are_the_moving_average_of_all_steps():
    module = RendererTrainer(Small(), SIDE, Training(epochs=1, ema=0.5))
    name = "layers.0.weight"
    seen = []
    for _ in range(4):
        with torch.no_grad():
            for parameter in module.renderer.parameters():
                parameter.add_(torch.randn_like(parameter))
        module.average.update_parameters(module.renderer)
        seen.append(module.renderer.state_dict()[name].clone())
    expected = seen[0]
    for count, value in enumerate(seen[1:], 1):
        kept = min(0.5, (1 + count) / (10 + count))
        expected = kept * expected + (1 - kept) * value
    torch.testing.assert_close(module.averaged.state_dict()[name], expected)


def test_a_critic_without_weight_changes_nothing():
    weights = []
    for critic in (False, True):
        torch.manual_seed(5)
        renderer = Small()
        module = RendererTrainer(renderer, SIDE, Training(epochs=2, critic=critic, critic_weight=0.0, critic_width=2))
        module.configure_optimizers = partial(_same_optimizers, module)
        fit(module, Strokes(), epochs=2)
        weights.append(renderer.state_dict())
    for name, value in weights[0].items():
        torch.testing.assert_close(weights[1][name], value, msg=name)


def _same_optimizers(module: RendererTrainer) -> list[torch.optim.Optimizer]:
    """Plain ones, because beside a critic the renderer's has another momentum."""
    parts = [module.renderer, *([] if module.critic is None else [module.critic])]
    return [torch.optim.SGD(part.parameters(), 1e-3) for part in parts]


def test_the_critic_pulls_as_hard_as_its_weight_says():
    push, pull = torch.randn(3, 4, 5, 7), 1e5 * torch.randn(3, 4, 5, 7)
    added = balanced(push, pull, 0.25) - push
    torch.testing.assert_close(added.norm(), 0.25 * push.norm())
    torch.testing.assert_close(
        torch.nn.functional.cosine_similarity(added.flatten(), pull.flatten(), 0), torch.tensor(1.0)
    )
    assert torch.equal(balanced(push, torch.zeros_like(pull), 0.25), push)


def test_half_precision_trains_in_32_bit_weights():
    module = RendererTrainer(Small(), SIDE, Training(epochs=2, bfloat16=True))
    fit(module, Strokes(8), epochs=2)
    assert {value.dtype for value in module.renderer.parameters()} == {torch.float32}
    assert math.isfinite(module.figures["l2"])


def test_a_renderer_that_cannot_be_trained_is_refused():
    with pytest.raises(UserError, match="try renderer=neural"):
        RendererTrainer(Analytic(), SIDE, Training(epochs=1))
    with pytest.raises(UserError, match=r"set renderer.window=64"):
        RendererTrainer(Small(), 64, Training(epochs=1))
    with pytest.raises(UserError, match="set minutes=60"):
        Training()
    with pytest.raises(UserError, match=r"ema=1 "):
        Training(epochs=1, ema=1.0)
    with pytest.raises(UserError, match=r"lr=-1 "):
        Training(epochs=1, lr=-1.0)


def test_errors_are_those_of_the_formulas():
    images, truth = torch.rand(3, 4, 5, 7), torch.rand(3, 4, 5, 7)
    figures = (errors_of(images[:1], truth[:1]) + errors_of(images[1:], truth[1:])).figures()
    a, b = images[:, 3:], truth[:, 3:]
    difference = torch.cat([images[:, :3] * a - truth[:, :3] * b, a - b], 1)
    assert figures["l2"] == pytest.approx(float(difference.square().mean()), rel=1e-5)
    assert figures["psnr_alpha"] == pytest.approx(-10 * math.log10(float((a - b).square().mean())), rel=1e-5)
    color = ((images[:, :3] - truth[:, :3]).square() * b).sum() / (3 * b.sum())
    assert figures["psnr_color"] == pytest.approx(-10 * math.log10(float(color)), rel=1e-5)


def test_a_colour_without_paint_counts_nothing():
    truth = torch.rand(2, 4, 6, 8)
    truth[:, 3, :, 4:] = 0
    images = truth.clone()
    images[:, :3, :, 4:] = torch.rand(2, 3, 6, 4)
    assert squared_error(images, truth) == 0
    figures = errors_of(images, truth).figures()
    assert figures["psnr_alpha"] == figures["psnr_color"] == math.inf
    assert torch.equal(premultiplied(images)[:, 3], images[:, 3])
    assert decibels(0.01) == pytest.approx(20)
    with pytest.raises(ValueError, match="no strokes"):
        Errors().figures()


def test_the_sheet_shows_pairs_over_white():
    drawn, truth = torch.zeros(7, 4, 64, 64), torch.ones(7, 4, 64, 64)
    picture = sheet_of_pairs(drawn, truth)
    assert picture.shape == (3, 2 * 136, 6 * 264)
    assert picture.min() >= 0.5
    truth[:, :3] = 0
    assert bool((sheet_of_pairs(drawn, truth)[:, :128, 128:256] == 0).all()), "truth on the right"
    assert bool((sheet_of_pairs(drawn, truth)[:, :128, :128] == 1).all())


@pytest.fixture(scope="module")
def file(tmp_path_factory) -> Path:
    """A file of 96 strokes, of which 64 are for training."""
    return write(tmp_path_factory.mktemp("strokes") / "strokes", n=96, window=64)


def test_the_task_leaves_a_renderer_that_can_be_loaded(config, file, tmp_path):
    cfg = config("task=train", f"data=[{file}]", "epochs=2", "minutes=null", "batch_size=32", *TINY)
    assert cfg.renderer.checkpoint is None, "a renderer is trained from the start unless one says otherwise"
    data = train.stroke_data(cfg)
    module = RendererTrainer(train.build(cfg.renderer), data.origin.window, train.training_of(cfg))
    train.fit(module, data, cfg, tmp_path, torch.device("cpu"), None)
    metrics = train.finish(module, data, cfg, tmp_path, time.monotonic(), torch.device("cpu"))
    names = {str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*") if path.is_file()}
    pictures = {"pictures/epoch_000.png", "pictures/epoch_001.png", "validation.png"}
    assert names == {"neural.safetensors", "neural.json", "metrics.json", "curves/metrics.csv"} | pictures
    assert metrics["status"] == "completed"
    assert metrics["steps"] == 4
    assert (tmp_path / "curves" / "metrics.csv").read_text().count("\n") == 3, "a header and two validations"
    path = tmp_path / "neural.safetensors"
    recipe = read_recipe(path)
    assert recipe["figures"]["validation"] == module.figures
    kept = json.loads((tmp_path / "metrics.json").read_text())
    assert kept["psnr_alpha"] == recipe["figures"]["test"]["psnr_alpha"]
    assert kept["fid_effl0"] > 0
    assert recipe["data"]["engine"] == "spot"
    assert recipe["data"]["strokes"] == [96]
    assert recipe["training"]["steps"] == 4
    options = {"width": 4, "widest": 8, "dense": [16], "checkpoint": str(path)}
    loaded = build_named("renderer", "neural", options)
    assert weights_hash(loaded) == metrics["renderer_hash"]
    with torch.no_grad():
        drawn = window_pictures(loaded, data.sets[0].parameters[:4], 64)
        torch.testing.assert_close(drawn, window_pictures(module.averaged.eval(), data.sets[0].parameters[:4], 64))


def test_a_set_is_simulated_once_and_kept(config, tmp_path):
    def paths(*more: str) -> list[Path]:
        cfg = config("task=train", "engine=disc", "simulate=40", "epochs=1", f"sets={tmp_path}", *more)
        return [file.path for file in train.stroke_data(cfg).sets]

    (path,) = paths()
    before = path.stat().st_mtime_ns
    assert paths() == [path]
    assert path.stat().st_mtime_ns == before
    assert paths("seed=1") != [path]
    assert paths("engine.window=128") != [path]


def test_training_goes_on_from_a_checkpoint(config, file, tmp_path):
    cfg = config("task=train", f"data=[{file}]", "epochs=1", "minutes=null", "batch_size=32", "renderer=dual")
    data = train.stroke_data(cfg)
    module = RendererTrainer(train.build(cfg.renderer), 64, train.training_of(cfg))
    train.fit(module, data, cfg, tmp_path, torch.device("cpu"), None)
    train.finish(module, data, cfg, tmp_path, time.monotonic(), torch.device("cpu"))
    cfg.renderer.checkpoint = str(tmp_path / "dual.safetensors")
    again = RendererTrainer(train.build(cfg.renderer), 64, train.training_of(cfg))
    assert weights_hash(again.renderer) == weights_hash(module.averaged)
    assert again.renderer.training


@pytest.mark.parametrize("wrong", ["precision=half", "epochs=null", "lr=0"])
def test_wrong_settings_are_refused(config, wrong):
    with pytest.raises(UserError, match=wrong.partition("=")[0]):
        train.training_of(config("task=train", "minutes=null", "epochs=1", wrong))


@pytest.mark.slow
def test_an_interrupted_training_is_kept_and_goes_on(file, tmp_path):
    settings = ["epochs=12", "minutes=null", "batch_size=8", "threads=1", "checkpoint_every=0", f"data={file}", *TINY]
    process = Program("task=train", *settings, f"output={tmp_path}/a", cwd=tmp_path)
    while not (tmp_path / "a" / "checkpoint.ckpt").exists() and process.poll() is None:
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=120)
    assert process.returncode == 130, out + err
    assert f"continue with: python run.py task=train resume={tmp_path}/a" in out
    first = json.loads((tmp_path / "a" / "metrics.json").read_text())
    assert first["status"] == "interrupted"
    assert 0 < first["steps"] < 96
    resumed = run("task=train", f"resume={tmp_path}/a", f"output={tmp_path}/b", cwd=tmp_path)
    assert resumed.returncode == 0, resumed.stdout + resumed.stderr
    assert not resumed.stderr, "no warnings"
    last = json.loads((tmp_path / "b" / "metrics.json").read_text())
    assert (last["status"], last["steps"]) == ("completed", 96)
    assert "renderer.checkpoint=" in resumed.stdout
