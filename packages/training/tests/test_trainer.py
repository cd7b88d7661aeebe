"""Test that renderers learn with Lightning's Trainer, that weights are averaged, and that training resumes exactly."""

import copy
import math
from contextlib import nullcontext
from types import SimpleNamespace

import lightning as L
import pytest
import torch
from brushexp_training.evaluation.evaluation import squared_error
from brushexp_training.fitting import network_module, renderer_module
from brushexp_training.fitting.network_fitting import MovingAverage
from brushexp_training.fitting.renderer_module import RendererModule, RendererSettings
from brushexp_training.rules import check_brushes
from brushexp_training.stroke_sets.datamodule import StrokeBatch, StrokeLoader
from brushexp_training.stroke_sets.dataset import Origin
from lightning.pytorch.callbacks import Checkpoint
from refusals import refuses
from test_callbacks import Line
from test_callbacks import fit as fit_line
from torch import nn
from torch.utils.data import DataLoader

from brushexp.config.check import check
from brushexp.errors import UserError
from brushexp.plugins.renderer.analytic import Analytic
from brushexp.plugins.renderer.base import PatchRenderer, window_pictures
from brushexp.strokes.prior import parameters_of, sample_prior
from brushexp.system.callbacks import TimedCheckpoint
from brushexp.system.status import Status

SIDE = 16
TINY = ("renderer.width=4", "renderer.dense=16", "renderer.code=2")
OPTIONS = dict.fromkeys(("enable_progress_bar", "enable_model_summary", "logger"), False)
OPTIONS |= {"accelerator": "cpu", "num_sanity_val_steps": 0}
CRITIC = RendererSettings(critic=True, critic_width=4)


class Small(PatchRenderer):
    """A renderer for 16 x 16 pixels, with two layers and a batch norm, whose buffers must also be averaged."""

    window = SIDE

    def __init__(self) -> None:
        super().__init__()
        hidden = nn.Linear(10, 32), nn.BatchNorm1d(32), nn.ReLU()
        self.layers = nn.Sequential(*hidden, nn.Linear(32, 4 * SIDE * SIDE), nn.Sigmoid())

    def draw(self, parameters):
        return self.layers(parameters).reshape(-1, 4, SIDE, SIDE)


def strokes(n: int, side: int = SIDE, first: int = 0) -> StrokeBatch:
    """Return a batch of analytic strokes as training data."""
    parameters = parameters_of(sample_prior(n, 0, first))
    with torch.no_grad():
        return StrokeBatch(parameters, window_pictures(Analytic(soft=1.0), parameters, side), torch.arange(n) + first)


class Strokes(L.LightningDataModule):
    """A few analytic strokes, in an order that depends on the epoch."""

    def __init__(self, n: int = 32, batch: int = 8) -> None:
        super().__init__()
        self.known, self.batch = strokes(n), batch

    def batches(self, epoch, first):
        order = torch.randperm(len(self.known.number), generator=torch.Generator().manual_seed(epoch))
        for part in order.split(self.batch)[first:]:
            yield StrokeBatch(*(value[part] for value in self.known))

    def train_dataloader(self):
        return StrokeLoader(self.batches, -(-len(self.known.number) // self.batch))

    def val_dataloader(self):
        return DataLoader([strokes(5, first=100)], batch_size=None)


def module_of(settings: RendererSettings | None = None, seed: int = 3) -> RendererModule:
    torch.manual_seed(seed)
    return RendererModule(Small(), SIDE, settings or RendererSettings())


def fit(module, data=None, *callbacks, resume=None, **options):
    writes = any(isinstance(callback, Checkpoint) for callback in callbacks)
    trainer = L.Trainer(callbacks=list(callbacks), enable_checkpointing=writes, **(OPTIONS | options))
    trainer.fit(module, data or Strokes(), ckpt_path=resume)
    return trainer


class Rates(L.Callback):
    """Callback that records the learning rate at each step."""

    def __init__(self):
        self.rates = []

    def on_before_optimizer_step(self, trainer, pl_module, optimizer):
        self.rates.append(optimizer.param_groups[0]["lr"])


class StopAt(L.Callback):
    """Callback that interrupts a fit after a given number of steps."""

    def __init__(self, step):
        self.step = step

    def on_train_batch_end(self, trainer, pl_module, *_):
        if pl_module.global_step >= self.step and not trainer.is_last_batch and not pl_module.stop:
            pl_module.stop, trainer.should_stop = Status.INTERRUPTED, True


def test_a_few_strokes_are_learned_validated_and_counted_where_gradients_are_accumulated():
    module, data = module_of(RendererSettings(lr=0.01)), Strokes(8)

    @torch.no_grad()
    def error() -> float:
        drawn = window_pictures(module.renderer.eval(), data.known.parameters, SIDE)
        module.renderer.train()
        return float(squared_error(drawn, data.known.images))

    before = error()
    fit(module, data, MovingAverage(0.9), max_epochs=60)
    assert error() < 0.2 * before
    assert module.global_step == module.validated == 60
    assert set(module.figures) == {"l2", "psnr_alpha", "psnr_color"}
    module = module_of()
    fit(module, Strokes(20), max_epochs=2, accumulate_grad_batches=2)
    assert (module.global_step, module.seen) == (4, 40)


@pytest.mark.parametrize("settings", [RendererSettings(), CRITIC], ids=["plain", "critic"])
def test_so_many_steps_in_half_precision_are_taken_and_validated_in_32_bit_weights(settings):
    dtypes = set()

    class Watch(L.Callback):
        def on_validation_batch_end(self, trainer, pl_module, outputs, *_):
            dtypes.add(outputs.dtype)

    module, rates = module_of(settings), Rates()
    assert fit(module, None, Watch(), rates, max_steps=7, precision="bf16-mixed").global_step == 7 == len(rates.rates)
    assert module.progress == 1
    assert module.critic is None or float(module.critic.layers[-1].weight.grad.abs().sum()) > 0
    assert {value.dtype for value in module.parameters()} == dtypes == {torch.float32}
    assert math.isfinite(module.figures["l2"])


def test_the_rate_rises_and_falls_to_its_end(monkeypatch):
    monkeypatch.setattr(network_module, "WARMUP_STEPS", 20)
    rates = Rates()
    fit(module_of(RendererSettings(lr=1.0)), Strokes(8), rates, max_epochs=50)
    first, *_, last = curve = rates.rates
    peak = curve.index(max(curve))
    assert (first, 0.9 < curve[peak] <= 1, last < 0.02) == (0.05, True, True)
    assert curve == sorted(curve[: peak + 1]) + sorted(curve[peak + 1 :], reverse=True)
    unlimited = Rates()
    fit(module_of(RendererSettings(lr=1.0)), None, unlimited, StopAt(23), max_epochs=-1)
    assert unlimited.rates[-1] == 1, "without a limit the rate stays at its peak"


@pytest.mark.parametrize("wrong", ["loss", "gradient", "critic"])
def test_a_step_that_gives_no_numbers_is_not_taken_and_ends_the_training(wrong):
    before, module = (module_of(CRITIC if wrong == "critic" else None) for _ in range(2))
    fit(before, None, StopAt(2), max_epochs=3)
    step = module.training_step

    def training_step(batch, batch_idx):
        if batch_idx < 2:
            return step(batch, batch_idx)
        if wrong == "critic":
            with torch.no_grad():
                list(module.critic.parameters())[-1].fill_(torch.nan)
        loss = step(batch, batch_idx)
        if wrong == "gradient":
            weight = next(module.parameters())
            return loss + (weight - weight.detach()).abs().sum().sqrt()  # its gradient is 0 times infinity
        if wrong != "critic":
            module.terms["loss/l2"] = torch.tensor(torch.nan)
        return loss

    module.training_step = training_step
    fit(module, None, max_epochs=3)
    reason = {"loss": "loss/l2 is nan", "gradient": "the gradient is not finite", "critic": "loss/critic is nan"}
    assert (module.stop, module.global_step) == (Status.DIVERGED, 3)
    assert module.trouble == f"step 3: {reason[wrong]}"
    for (name, weight), expected in zip(module.named_parameters(), before.parameters(), strict=True):
        assert name.startswith("critic") or torch.equal(weight, expected), name


@pytest.mark.parametrize("validating", [False, True])
def test_what_a_failed_fit_leaves_is_the_average_that_is_validated(validating):
    class Fail(L.Callback):
        def on_train_batch_end(self, trainer, pl_module, *_):
            if pl_module.global_step == 3 and not validating:
                raise RuntimeError("no memory")

        def on_validation_batch_end(self, trainer, *_):
            if validating and trainer.state.fn == "fit":
                raise RuntimeError("no memory")

    stopped, module, average = module_of(), module_of(), MovingAverage(0.9)
    fit(stopped, None, MovingAverage(0.9), StopAt(4 if validating else 3), max_epochs=1)
    trainer = L.Trainer(callbacks=[average, Fail()], max_epochs=1, **OPTIONS)
    with pytest.raises(RuntimeError, match="no memory"):
        trainer.fit(module, Strokes())
    trainer.validate(module, Strokes(), verbose=False)
    assert module.global_step == (4 if validating else 3)
    torch.testing.assert_close(module.state_dict(), stopped.state_dict(), rtol=0, atol=0)
    figures = module.figures
    L.Trainer(**OPTIONS).validate(module, Strokes(), verbose=False)
    assert module.figures == figures


# Ctrl-C within the first epoch, right after an epoch and at its end, with four steps per epoch, or with one step.
@pytest.mark.parametrize(
    ("step", "n", "settings"),
    [*((step, 32, RendererSettings()) for step in (1, 8, 11)), (5, 32, CRITIC), (1, 8, CRITIC), (11, 8, CRITIC)],
)
def test_a_training_ends_at_ctrl_c_and_goes_on_to_the_same_weights(tmp_path, step, n, settings):
    class Press(L.Callback):
        def on_train_batch_end(self, trainer, pl_module, *_):
            if pl_module.global_step == step:
                checkpoint.pressed.set()

    path, epochs = tmp_path / "checkpoint.ckpt", 12 * 8 // n
    checkpoint, (whole, halved, resumed) = TimedCheckpoint(path, None), (module_of(settings, k) for k in (3, 3, 99))
    fit(whole, Strokes(n), MovingAverage(0.99), TimedCheckpoint(path, None), max_epochs=epochs)
    fit(halved, Strokes(n), Press(), MovingAverage(0.99), checkpoint, max_epochs=epochs)
    assert step <= halved.global_step < 12
    assert halved.stop == Status.INTERRUPTED
    spent = torch.load(path)["cpu_seconds"]
    beside = (MovingAverage(0.99), TimedCheckpoint(path, None))
    fit(resumed, Strokes(n), *beside, resume=str(path), max_epochs=epochs)
    assert resumed.global_step == whole.global_step == 12
    torch.testing.assert_close(resumed.state_dict(), whole.state_dict(), rtol=0, atol=0)
    assert resumed.figures == whole.figures
    assert resumed.seen == whole.seen == 96
    assert 0 < spent < resumed.cpu_seconds


def test_a_network_that_draws_nothing_is_begun_anew_and_one_that_draws_or_has_drawn_one_stroke_is_not(
    monkeypatch, caplog
):
    monkeypatch.setattr(renderer_module, "START_STEPS", 2)
    for dead in (True, False):
        module = module_of(RendererSettings())
        alive = copy.deepcopy(module.renderer)
        if dead:
            for weight in module.renderer.parameters():
                torch.nn.init.constant_(weight, 0.0)
            torch.nn.init.constant_(list(module.renderer.parameters())[-1], -1e3)
        caplog.clear()
        restart = renderer_module.FreshStart(lambda: alive)  # noqa: B023
        fit(module, None, restart, max_epochs=2)
        assert (restart.restarts, restart.lives) == (int(dead), True)
        assert ("restarted with fresh weights, 1 of 3 times" in caplog.text) == dead
    module = SimpleNamespace(renderer=Small().eval(), window=SIDE, global_step=9)
    never = renderer_module.FreshStart(Small, most=0)
    never.on_train_batch_end(None, module, None, strokes(8), 0)
    assert never.restarts == 0, "fresh_starts=0"
    monkeypatch.setattr(renderer_module, "START_STEPS", 2)
    restart = renderer_module.FreshStart(Small)
    for step, n in ((2, 1), (3, 8)):
        module = SimpleNamespace(renderer=Small().eval(), window=SIDE, global_step=step)
        restart.on_train_batch_end(None, module, None, strokes(n), 0)
        assert (restart.restarts, restart.lives) == (0, n == 8)


def test_what_cannot_be_trained_is_refused_before_it_starts(config):
    for renderer, window, cure in ((Analytic(), SIDE, "try renderer=neural"), (Small(), 64, "set renderer.window=64")):
        refuses(cure, RendererModule, renderer, window, RendererSettings())
    with pytest.raises(UserError, match=r"critic=true halves .* which is impossible for 48; .*engine.window=64"):
        check(config("task=train", "critic=true", "engine.window=48", "renderer.window=48"))
    for brushes, message in ((8, None), (16, None), (1, None), (12, "set renderer.brushes=8")):
        cfg = config("task=train", "engine.brushes=8", f"renderer.brushes={brushes}")
        with pytest.raises(UserError, match=message) if message else nullcontext():
            check(cfg)
    origin = Origin("spot", {"brushes": 8}, 64)
    with pytest.raises(UserError, match=r"names 2 sets, .* give one set, and make it larger with n="):
        check_brushes(config("task=train"), origin, 2)
    check_brushes(config("task=train", "renderer=inverse_vgg"), origin, 2)


def test_the_average_lags_behind_and_is_left_in_place(tmp_path):
    plain, averaged = Line(), Line()
    fit_line(tmp_path, plain)
    fit_line(tmp_path, averaged, callbacks=[MovingAverage(0.9)])
    assert 0 < averaged.weight.item() < plain.weight.item()
