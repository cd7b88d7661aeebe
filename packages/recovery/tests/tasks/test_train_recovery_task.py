"""Test that task=train_recovery writes weights only when they are complete, and that a run resumes to its judges."""

import time
from types import SimpleNamespace

import pytest
from brushexp_recovery.model.recovery_model import load_model
from brushexp_recovery.synthesis.pool import save_painting
from brushexp_recovery.tasks import train
from brushexp_recovery.train.data import FIRST_HELD_OUT, HELD_OUT_COUNT, RecoveryData
from omegaconf import OmegaConf
from recovery_scenes import bars

from brushexp.runs import resume
from brushexp.system import callbacks

WORDS = ("task=train_recovery", "families=false", "minutes=null", "trainer.max_steps=2", "batch_size=1", "paintings=2")


@pytest.fixture
def pool(tmp_path, monkeypatch):
    """Make all paintings of a short training in advance, so that no process has to make them."""
    monkeypatch.setattr(RecoveryData, "start_painting", lambda _: None)
    folder = tmp_path / "pool"
    folder.mkdir()
    for number in [0, 1, *range(FIRST_HELD_OUT, FIRST_HELD_OUT + HELD_OUT_COUNT)]:
        save_painting(folder / f"{number:06d}.npz", bars())
    return folder


def test_weights_are_written_after_the_judges_and_an_interrupted_run_resumes_to_them(
    pool, config, tmp_path, monkeypatch
):
    def interrupt(*_):
        raise KeyboardInterrupt

    folder = tmp_path / "run"
    folder.mkdir()
    hydra = OmegaConf.create({"overrides": {"task": []}, "runtime": {"output_dir": str(folder)}})
    monkeypatch.setattr(resume, "HydraConfig", SimpleNamespace(get=lambda: hydra))
    monkeypatch.setattr(callbacks, "FIRST_CHECKPOINT", 0)  # after the first step
    monkeypatch.setattr(train, "fit_order_and_confidence", lambda *_: {})
    monkeypatch.setattr(train, "fit_classifiers", interrupt)
    with pytest.raises(KeyboardInterrupt):
        train.run(config(*WORDS, f"sets={pool}"), folder, time.monotonic())
    assert (folder / "checkpoint.ckpt").is_file()
    assert not [*folder.glob("*.safetensors")], "weights without judges find hardly any stroke"

    monkeypatch.setattr(train, "fit_classifiers", lambda model, paintings, *_: {"judged": float(len(paintings))})
    metrics = train.run(config("task=train_recovery", f"resume={folder}"), folder, time.monotonic())
    assert metrics["judged"] > 0
    assert metrics["steps"] == 2
    (weights,) = folder.glob("*.safetensors")
    load_model(str(weights))
