"""Callbacks of every fit: progress, checkpoints by time, Ctrl-C."""

import signal
import tempfile

import lightning as L
import pytest
import torch
from lightning.pytorch.loggers import CSVLogger
from omegaconf import OmegaConf

from brushexp.errors import UserError
from brushexp.runs.trainer import make_trainer
from brushexp.system.callbacks import INTERRUPTED


class Line(L.LightningModule):
    """One weight that is drawn to 1; a step takes what ``beside`` does."""

    def __init__(self, steps=8, beside=lambda step: None):
        super().__init__()
        self.weight = torch.nn.Parameter(torch.zeros(1))
        self.steps, self.beside, self.stop = steps, beside, ""

    title = "drawing a line"

    @property
    def progress(self):
        return self.global_step / self.steps

    def state_line(self):
        return f"weight {self.weight.item():.2f}"

    def train_dataloader(self):
        return iter(lambda: 0, 1)  # without end

    def training_step(self, batch, batch_idx):
        self.beside(batch_idx)
        loss = (self.weight - 1).square().sum()
        self.log("psnr", -loss)
        return loss

    def configure_optimizers(self):
        return torch.optim.SGD(self.parameters(), lr=0.1)

    def on_train_batch_end(self, *_):
        self.trainer.should_stop |= self.progress >= 1


def fit(folder, module, *, chosen=(), resume=None, every=None, callbacks=(), **trainer):
    options = {"enable_progress_bar": False, "max_epochs": 1, "enable_model_summary": False, "log_every_n_steps": 1}
    cfg = {"task": "paint", "callbacks": dict(chosen), "trainer": options | trainer, "checkpoint_every": every}
    logger = CSVLogger(tempfile.mkdtemp(dir=folder), name="", version="")
    made = make_trainer(OmegaConf.create(cfg), torch.device("cpu"), folder, [logger], callbacks)
    made.fit(module, ckpt_path=resume)
    return made


def test_a_fit_tells_where_it_stands_and_leaves_a_checkpoint(tmp_path, caplog):
    caplog.set_level("INFO")
    saved = []
    module = Line(beside=lambda step: saved.append((tmp_path / "checkpoint.ckpt").exists()))
    trainer = fit(tmp_path, module, every=0)
    assert trainer.global_step == 8
    assert saved == [False, *[True] * 7]
    assert (tmp_path / "checkpoint.ckpt").exists(), "until the task has written its results"
    assert "drawing a line: 100 %, weight 0.83, 0:00:00 left" in caplog.text


def test_ctrl_c_ends_cleanly_and_the_fit_continues_exactly(tmp_path):
    straight = Line()
    fit(tmp_path, straight)
    first = Line(beside=lambda step: step == 3 and signal.raise_signal(signal.SIGINT))
    assert fit(tmp_path, first).global_step == 4
    assert first.stop == INTERRUPTED
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    second = Line()
    trainer = fit(tmp_path, second, resume=tmp_path / "checkpoint.ckpt")
    assert trainer.global_step == 8
    assert second.stop == ""
    assert torch.equal(second.weight, straight.weight)
    with pytest.raises(ZeroDivisionError):
        fit(tmp_path, Line(beside=lambda step: 1 / 0))
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_an_unknown_option_of_the_trainer_is_refused(tmp_path):
    with pytest.raises(UserError, match=r"trainer: .*speed"):
        fit(tmp_path, Line(), speed=9)
