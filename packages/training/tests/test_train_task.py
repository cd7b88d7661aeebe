"""Test that ``task=train`` trains a renderer, writes it with its figures, and logs a command that paints with it."""

import json
import logging
import shlex
from functools import partial
from itertools import islice
from pathlib import Path
from types import SimpleNamespace

import pytest
import torch
from brushexp_training.fitting.network_fitting import fit_network
from brushexp_training.rules import check_ends
from brushexp_training.stroke_sets import stroke_data
from brushexp_training.stroke_sets.dataset import Origin
from brushexp_training.tasks import train
from refusals import refuses
from sweeps import read_csv
from test_dataset import write
from test_trainer import TINY, Strokes, module_of
from torch.utils.data import DataLoader, IterableDataset

from brushexp.errors import UserError
from brushexp.plugins.renderer.base import RENDERERS
from brushexp.registry import build, build_named
from brushexp.system.checkpoint import weights_hash


def test_a_renderer_looks_at_strokes_as_large_as_the_engine_paints_them(config):
    assert train.large_engine(Origin("disc", {"window": 64}, 64)).window == 512
    assert train.large_engine(Origin("wash", {"window": 64}, 64)).window == 1024
    small = ("renderer.variants=1", "renderer.rows=16", "renderer.columns=32")
    data = SimpleNamespace(origin=Origin("disc", {"window": 64}, 64), first_seed=0)
    before = build_named("renderer", "textured", {"variants": 1, "rows": 16, "columns": 32, "checkpoint": None})
    renderer = train.first_renderer(config("task=train", "renderer=textured", *small), data)
    assert not torch.equal(renderer.textures, before.textures)


@pytest.fixture(scope="module")
def stored(tmp_path_factory) -> Path:
    """Write a set of 96 strokes, 64 of them for training."""
    return write(tmp_path_factory.mktemp("strokes") / "strokes", n=96, window=64)


@pytest.fixture
def trained(run_task, stored):
    common = ["task=train", f"data=[{stored}]", "minutes=null", "batch_size=32", "device=cpu"]
    return partial(run_task, train, *common)


def test_the_task_leaves_a_renderer_that_can_be_loaded(trained, stored, tmp_path):
    metrics = trained("epochs=2", "trainer.log_every_n_steps=2", *TINY)
    names = {str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*") if path.is_file()}
    pictures = {"pictures/epoch_000.png", "pictures/epoch_001.png", "validation.png"}
    assert names == {"neural.safetensors", "neural.json", "metrics.json", "curves/metrics.csv"} | pictures
    assert (metrics["status"], metrics["steps"], metrics["strokes_seen"]) == ("completed", 4, 128)
    assert metrics["cpu_seconds"] > 0
    rows = read_csv(tmp_path / "curves" / "metrics.csv")
    assert all(row["validation/psnr_alpha"] and row["validation/fid_effl0"] for row in rows if not row["loss/l2"])
    path = tmp_path / "neural.safetensors"
    recipe = RENDERERS.read_recipe(path)
    written = json.loads((tmp_path / "metrics.json").read_text())
    assert written["psnr_alpha"] == recipe["figures"]["test"]["psnr_alpha"]
    assert written["fid_effl0"] > 0
    assert (recipe["data"]["engine"], recipe["data"]["strokes"]) == ("spot", [96])
    assert (recipe["training"]["steps"], recipe["training"]["precision"]) == (4, "bf16-mixed")
    assert recipe["training"]["provenance"] == written["provenance"]
    assert written["provenance"]["torch"] == torch.__version__
    loaded = build_named("renderer", "neural", {"width": 4, "dense": 16, "code": 2, "checkpoint": str(path)})
    assert weights_hash(loaded) == metrics["renderer_hash"]


def test_the_recipe_has_all_options_of_the_trainer(trained, config, tmp_path):
    words = ["trainer.max_epochs=2", "trainer.accumulate_grad_batches=2"]
    assert trained(*words, "fid=0", *TINY)["steps"] == 2
    options = RENDERERS.read_recipe(tmp_path / "neural.safetensors")["training"]["trainer"]
    assert (options["max_epochs"], options["accumulate_grad_batches"]) == (2, 2)
    assert options.keys() == config("task=train").trainer.keys()


def test_the_words_that_it_ends_with_paint_with_what_it_has_trained(trained, config, tmp_path, caplog, monkeypatch):
    caplog.set_level(logging.INFO)
    monkeypatch.setattr(train, "share_drawn", lambda drawn, true: 0.5)
    words = ["renderer=inverse_vgg", "renderer.width=4", "renderer.widest=8", "renderer.coordconv=none"]
    trained("epochs=0", "fid=0", "renderer.dense=[6,5]", "renderer.tint=false", *words)
    command = shlex.split(caplog.text.rpartition("paint with it: brushexp ")[2])
    weights = f"renderer.checkpoint={tmp_path / 'inverse_vgg.safetensors'}"
    assert set(command) == {weights, "renderer.dense=[6, 5]", "renderer.tint=false", *words}
    assert build(config(*command).renderer).weights_hash


def test_a_network_that_draws_all_strokes_alike_is_not_said_to_paint(trained, monkeypatch, caplog):
    caplog.set_level(logging.INFO)
    monkeypatch.setattr(train, "share_drawn", lambda drawn, true: 0.001)
    trained("epochs=0", "fid=0", *TINY)
    assert "the network has learned nothing" in caplog.text
    assert "paint with it" not in caplog.text


def test_training_goes_on_from_a_checkpoint_and_weights_are_on_disk_before_they_are_judged(
    trained, tmp_path, monkeypatch
):
    first = trained("epochs=1", "renderer=dual", "fid=0")
    again = trained("epochs=0", "renderer=dual", f"renderer.checkpoint={tmp_path / 'dual.safetensors'}", "fid=0")
    assert again["renderer_hash"] == first["renderer_hash"]
    assert (again["steps"], again["seconds"]) == (0, 0)
    assert again["psnr_alpha"] == pytest.approx(first["psnr_alpha"], rel=1e-3), "weights are stored in 16 bits"

    def evaluate(*_):
        raise RuntimeError("no memory")

    monkeypatch.setattr(train, "evaluate", evaluate)
    with pytest.raises(RuntimeError, match="no memory"):
        trained("epochs=0", "fid=0", *TINY)
    path = tmp_path / "neural.safetensors"
    build_named("renderer", "neural", {"width": 4, "dense": 16, "code": 2, "checkpoint": str(path)})


def test_a_set_is_simulated_once_and_kept(config, tmp_path):
    def paths(*more: str) -> list[Path]:
        cfg = config("task=train", "engine=disc", "simulate=40", "epochs=1", f"sets={tmp_path}", *more)
        return [one.path for one in stroke_data.stroke_data(cfg).sets]

    (path,) = paths()
    before = {file: file.stat().st_mtime_ns for file in path.glob("*.h5")}
    assert paths() == [path]
    assert {file: file.stat().st_mtime_ns for file in path.glob("*.h5")} == before
    assert [path] not in (paths("seed=1"), paths("engine.window=128"))


@pytest.mark.parametrize(("limit", "steps"), [
    *[("epochs=2", 8), ("trainer.max_epochs=2", 8), ("trainer.max_steps=3", 3)],
    *[("trainer.max_time=00:00:00:00", 0), ("callbacks=timer callbacks.timer.duration=00:00:00:00", 0)],
    ("minutes=0.003", None),  # as many steps as fit
])  # fmt: skip
def test_any_limit_of_the_trainer_ends_a_training(limit, steps, config, tmp_path):
    words = ["task=train", "minutes=null", "ema=0"]
    refuses("set minutes=60", check_ends, config(*words))
    cfg, module = config(*words, *limit.split()), module_of()
    check_ends(cfg)
    fit_network(module, Strokes(), cfg, tmp_path, torch.device("cpu"), [])
    assert steps in (module.global_step, None)
    assert steps == 0 or (module.progress == 1 and module.seconds > 0)
    assert module.figures, "the weights so far are validated"


@pytest.mark.parametrize(("more", "batches"), [("", 4), ("trainer.limit_train_batches=0.5", 2)])
def test_validations_farther_apart_than_an_epoch_are_refused(more, batches, config, tmp_path):
    words = ["task=train", "epochs=1", "trainer.val_check_interval=5", *more.split()]
    message = f"val_check_interval=5 is more than the batches of an epoch, {batches}; try .*={batches}$"
    refuses(message, fit_network, module_of(), Strokes(), config(*words), tmp_path, torch.device("cpu"), [])


def test_what_is_learnt_is_left_if_a_step_and_then_the_validation_fail(config, tmp_path, caplog):
    class Damaged(Strokes):
        def batches(self, epoch, first):
            yield from islice(super().batches(epoch, first), 2)
            raise UserError("shard 0 is damaged")

        def val_dataloader(self):
            return DataLoader(Nothing(), batch_size=None)

    class Nothing(IterableDataset):
        def __iter__(self):
            raise UserError("shard 1 is damaged")

    cfg, module = config("task=train", "minutes=null", "epochs=2", "ema=0"), module_of()
    failure = fit_network(module, Damaged(), cfg, tmp_path, torch.device("cpu"), [])
    assert str(failure) == "shard 0 is damaged"
    assert module.global_step == 2
    assert "the weights are written without figures: shard 1 is damaged" in caplog.text
    with pytest.raises(UserError, match="shard 1 is damaged"):
        fit_network(module_of(), Damaged(), config("task=train", "epochs=0"), tmp_path, torch.device("cpu"), [])
