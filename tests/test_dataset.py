"""A set of strokes comes back from disk as it was; loaders hand out every stroke once; what is damaged is refused."""

import json
import re
from contextlib import suppress
from pathlib import Path

import h5py
import lightning as L
import numpy as np
import pytest
import torch
from torch import Tensor

from brushexp.errors import UserError
from brushexp.plugins.engine.base import Engine, Simulated
from brushexp.registry import plugins
from brushexp.strokes.prior import parameters_of, sample_prior
from brushexp.training import writer
from brushexp.training.datamodule import EngineSource, StrokeData
from brushexp.training.dataset import BLOCK, HEIGHT_STEPS, Origin, Split, StrokeSet, origin_of, require_same_origin
from brushexp.training.writer import StrokeWriter

N = 1000  # more than three groups of blocks, and the last block is short
SHARD_STROKES = 256  # in these tests, so that there are several


class Spot(Engine):
    """A gradient whose phase is the stroke's number and whose colour is the stroke's."""

    def __init__(self, window: int = 6) -> None:
        self.window = window

    def __call__(self, parameters: Tensor, *, seed: int, first: int = 0) -> Simulated:
        n, side = len(parameters), self.window
        ramp = torch.arange(side * side).reshape(side, side) / (side * side)
        phase = torch.arange(first, first + n)[:, None, None] * 0.1 + seed
        alpha = 0.5 + 0.5 * torch.sin(phase + 3 * ramp)
        color = 0.5 * (parameters[:, 7:] + 1)
        images = torch.cat([color[:, :, None, None].expand(n, 3, side, side), alpha[:, None]], dim=1)
        return Simulated(images, 7.5 * alpha)


def write(path: Path, n: int = N, seed: int = 0, window: int = 6, engine: str = "spot", **config: object) -> Path:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(writer, "SHARD_STROKES", SHARD_STROKES)
        with StrokeWriter(path, Origin(engine, {"radius": 0.25} | config, window), seed, n) as set_writer:
            set_writer.fill(Spot(window))
    return path


@pytest.fixture(scope="module")
def kept(tmp_path_factory) -> Path:
    return write(tmp_path_factory.mktemp("set") / "strokes")


@pytest.fixture(scope="module")
def small(tmp_path_factory) -> bytes:
    """A set of one shard."""
    return (write(tmp_path_factory.mktemp("set") / "small", n=200) / "000000000.h5").read_bytes()


@pytest.fixture
def stored(small, tmp_path) -> Path:
    path = tmp_path / "strokes.h5"
    path.write_bytes(small)
    return path


def read_all(path: Path) -> tuple:
    found = StrokeSet(path)
    numbers = np.arange(len(found))
    try:
        return found.origin, found.seed, found.parameters, found.pictures(numbers), found.heights(numbers)
    finally:
        for shard in found.shards:
            shard.close()


def refused(path: Path) -> str:
    """The message with which reading all of it is refused: one line that names the file once."""
    with pytest.raises(UserError) as caught:
        read_all(path)
    message = str(caught.value)
    assert "\n" not in message
    assert str(path) in message
    assert str(path) + ": " + str(path) not in message
    return message


def numbers_of(loader) -> Tensor:
    return torch.cat([batch.number for batch in loader])


def test_a_set_comes_back_as_it_was_simulated(kept):
    found = StrokeSet(kept)
    parameters = parameters_of(sample_prior(N))
    simulated = Spot()(parameters, seed=0)
    assert (len(found), found.origin, found.seed) == (N, Origin("spot", {"radius": 0.25}, 6), 0)
    assert [len(shard) for shard in found.shards] == [256, 256, 256, 232]
    assert torch.equal(found.parameters, parameters)
    numbers = np.array([3, 999, 0, 500, 17, 16, 255, 256, 15])
    images = torch.from_numpy(found.pictures(numbers)).permute(0, 3, 1, 2) / 255
    torch.testing.assert_close(images, simulated.images[numbers], rtol=0, atol=0.5 / 255 + 1e-6)
    torch.testing.assert_close(found.heights(numbers), simulated.heights[numbers], rtol=0, atol=0.6 / HEIGHT_STEPS)
    attributes = {"format", "format_version", "first", "n", "seed", "engine", "engine_config", "window", "splits"}
    assert set(found.shards[1].file.attrs) == attributes
    assert all(dataset.fletcher32 and len(dataset.attrs["unit"]) for dataset in found.shards[1].file.values())


@pytest.mark.parametrize("n", [1, 15, 33, 640, 1000, 5003])
def test_splits_share_out_all_strokes_and_keep_them_when_the_set_grows(n):
    numbers = {split: split.numbers(n) for split in Split}
    assert sorted(np.concatenate(list(numbers.values()))) == list(range(n))
    for split, found in numbers.items():
        assert np.array_equal(split.numbers(n + 777)[: len(found)], found)
    if n > 5000:
        assert 0.04 < len(numbers[Split.TEST]) / n < 0.06
        assert 0.04 < len(numbers[Split.VALIDATION]) / n < 0.06


@pytest.mark.parametrize("prefetch", [0, 3])
@pytest.mark.parametrize("batch_size", [7, 64, 5000])
def test_every_training_stroke_comes_once_in_an_epoch_and_in_another_order_in_the_next(kept, batch_size, prefetch):
    loader = StrokeData([kept], batch_size=batch_size, prefetch=prefetch).train_dataloader()
    epochs = [list(loader), list(loader)]
    orders = [numbers_of(epoch) for epoch in epochs]
    for epoch, order in zip(epochs, orders, strict=True):
        assert len(epoch) == len(loader)
        assert torch.equal(order.sort().values, torch.from_numpy(Split.TRAINING.numbers(N)))
    assert not torch.equal(*orders)
    assert (orders[0][1:] - orders[0][:-1] == 1).float().mean() < 0.05, "neighbours are apart"


def test_rows_of_a_batch_belong_together(kept):
    batch = next(iter(StrokeData([kept], batch_size=33).train_dataloader()))
    assert (batch.parameters.shape, batch.images.shape) == ((33, 10), (33, 4, 6, 6))
    assert (batch.images.dtype, batch.number.dtype) == (torch.float32, torch.int64)
    parameters = parameters_of(sample_prior(N))
    assert torch.equal(batch.parameters, parameters[batch.number])
    expected = Spot()(parameters, seed=0).images[batch.number]
    torch.testing.assert_close(batch.images, expected, rtol=0, atol=0.5 / 255 + 1e-6)


def test_seed_and_epoch_decide_the_order(kept):
    def order(seed: int, epoch: int) -> Tensor:
        loader = StrokeData([kept], seed=seed).train_dataloader()
        loader.set_epoch(epoch)
        return numbers_of(loader)

    assert torch.equal(order(1, 4), order(1, 4))
    assert not torch.equal(order(1, 4), order(1, 5))
    assert not torch.equal(order(1, 4), order(2, 4))


@pytest.mark.parametrize("seen", [0, 9, 23])
def test_a_loader_goes_on_where_it_was(kept, seen):
    def loader():
        return StrokeData([kept], batch_size=37).train_dataloader()

    whole, first, second = loader(), loader(), loader()
    numbers = [batch.number for _ in range(2) for batch in whole]
    assert len(whole) == 24
    batches = iter(first)
    for _ in range(seen + 1):
        next(batches)
    second.load_state_dict(first.state_dict())
    going_on = [batch.number for _ in range(2) for batch in second][: len(numbers) - seen - 1]
    assert all(torch.equal(*pair) for pair in zip(going_on, numbers[seen + 1 :], strict=False))


def test_limit_takes_the_first_training_strokes_and_held_out_ones_come_in_order(kept):
    data = StrokeData([kept], batch_size=10, limit=50)
    assert sorted(numbers_of(data.train_dataloader()).tolist()) == Split.TRAINING.numbers(N)[:50].tolist()
    for loader, split in ((data.val_dataloader(), Split.VALIDATION), (data.test_dataloader(), Split.TEST)):
        for _ in range(2):
            assert numbers_of(loader).tolist() == split.numbers(N).tolist()


def test_several_sets_are_read_as_one(kept, tmp_path):
    other = write(tmp_path / "other", n=400, seed=1)
    data = StrokeData([kept, other], batch_size=50)
    batches = list(data.train_dataloader())
    sizes = ((N, 0), (400, 1))
    expected = np.concatenate([Split.TRAINING.numbers(n) for n, _ in sizes])
    assert sorted(numbers_of(batches).tolist()) == sorted(expected.tolist())
    rows = {tuple(row) for batch in batches for row in batch.parameters.tolist()}
    found = [parameters_of(sample_prior(n, seed))[Split.TRAINING.numbers(n)] for n, seed in sizes]
    assert rows == {tuple(row) for row in torch.cat(found).tolist()}
    assert len(numbers_of(data.test_dataloader())) == sum(len(Split.TEST.numbers(n)) for n, _ in sizes)


def test_sets_that_do_not_fit_together_are_refused(kept, tmp_path):
    for other, message in (
        ({"window": 8}, r"window 6, and .* has window 8; give sets that agree"),
        ({"engine": "blot"}, r"engine spot, and .* has engine blot"),
        ({}, r"hold the same strokes \(seed 0\)"),
    ):
        with pytest.raises(UserError, match=message):
            StrokeData([kept, write(tmp_path / f"other{len(message)}", n=40, **other)])
    with pytest.raises(UserError, match="no set of strokes is given"):
        StrokeData([])
    with pytest.raises(UserError, match="no stroke is for validation"):
        StrokeData([write(tmp_path / "d", n=BLOCK)])
    with pytest.raises(UserError, match="set limit to 1 or more"):
        StrokeData([kept], limit=0)


def test_an_engine_simulates_no_stroke_twice_and_the_batch_size_changes_none():
    def data(batch_size: int, **options) -> StrokeData:
        source = EngineSource(Spot(), Origin("spot", {}, 6), seed=3, steps=4, held_out=25)
        return StrokeData(source, batch_size=batch_size, **options)

    eight = data(8)
    loader = eight.train_dataloader()
    assert torch.equal(torch.cat([numbers_of(loader), numbers_of(loader)]), torch.arange(64))
    for held_out in (eight.val_dataloader(), eight.test_dataloader()):
        batches = list(held_out)
        assert [len(batch.number) for batch in batches] == [8, 8, 8, 1]
        assert numbers_of(batches).min() > 2**39
        assert torch.equal(list(held_out)[1].images, batches[1].images)
    few, many = (torch.cat([batch.images for batch in data(size).train_dataloader()]) for size in (4, 8))
    torch.testing.assert_close(few, many[:16])
    with pytest.raises(UserError, match="drop limit"):
        data(8, limit=5)


class Mean(L.LightningModule):
    """Learns nothing and notes what it sees."""

    def __init__(self) -> None:
        super().__init__()
        self.seen: list[int] = []
        self.level = torch.nn.Parameter(torch.zeros(()))

    def training_step(self, batch, index):
        self.seen += batch.number.tolist()
        return (batch.images.mean() - self.level) ** 2

    def validation_step(self, batch, index):
        assert set(batch.number.tolist()) <= set(Split.VALIDATION.numbers(N).tolist())

    def configure_optimizers(self):
        return torch.optim.SGD(self.parameters(), lr=0.1)


def test_lightning_continues_an_epoch_exactly(kept, tmp_path):
    quiet = dict.fromkeys(("logger", "enable_checkpointing", "enable_progress_bar", "enable_model_summary"), False)

    def fit(steps: int, checkpoint: Path | None = None) -> tuple[Mean, L.Trainer]:
        module = Mean()
        trainer = L.Trainer(accelerator="cpu", max_steps=steps, default_root_dir=tmp_path, **quiet)
        trainer.fit(module, StrokeData([kept], batch_size=100), ckpt_path=checkpoint)
        return module, trainer

    whole, _ = fit(14)
    begun, trainer = fit(5)
    trainer.save_checkpoint(tmp_path / "a.ckpt")
    rest, _ = fit(14, tmp_path / "a.ckpt")
    assert begun.seen + rest.seen == whole.seen


def test_a_set_of_another_brush_is_refused():
    ours = Origin("fluid", {"load": 0.8, "frames": 20}, 64)
    require_same_origin(ours, Origin("fluid", {"frames": 20, "load": 0.8}, 64), "a")
    for theirs, message in (
        (Origin("dabs", {}, 64), "a was made with engine=dabs, .* made with engine=fluid"),
        (Origin("fluid", {"load": 0.5, "frames": 20}, 64), "with engine.load=0.5, .* with engine.load=0.8"),
        (Origin("fluid", {"frames": 20}, 64), "with no engine.load, .* with engine.load=0.8"),
        (Origin("fluid", {"load": 0.8, "frames": 20}, 128), "with the window=128, .* with the window=64"),
    ):
        with pytest.raises(UserError, match=message):
            require_same_origin(ours, theirs, "a")


def test_the_origin_of_an_engine_is_all_of_its_options(config):
    for plugin in plugins("engine"):
        node = config("task=simulate", f"engine={plugin.name}").engine
        origin = origin_of(node, Spot())
        assert origin.engine == plugin.name
        assert {"_target_", *origin.engine_config} == set(node)
        assert json.loads(json.dumps(origin.engine_config)) == origin.engine_config


def test_what_is_no_set_is_explained(tmp_path, stored):
    assert "make one with python run.py task=simulate" in refused(tmp_path / "nowhere")
    (tmp_path / "empty").mkdir()
    assert "there is no set of strokes at" in refused(tmp_path / "empty")
    path = tmp_path / "a.h5"
    for data in (b"", b"\x89PNG\r\n\x1a\n" + bytes(3000), b"x" * 5000):
        path.write_bytes(data)
        assert "not an HDF5 file" in refused(path)
    with h5py.File(path, "w") as file:
        file["params"] = np.zeros((3, 10))
    assert "not one of brushexp strokes" in refused(path)
    for share in (0.1, 0.5, 0.9, 0.999):
        path.write_bytes(stored.read_bytes()[: int(stored.stat().st_size * share)])
        assert "is damaged or cut short" in refused(path)


def test_shards_that_are_not_a_whole_set_are_refused(kept, tmp_path):
    files = sorted(kept.glob("0*.h5"))
    for name, chosen in (("gap", [files[0], files[2]]), ("end", files[1:])):
        (tmp_path / name).mkdir()
        for path in chosen:
            (tmp_path / name / path.name).write_bytes(path.read_bytes())
        assert "simulate again what it lacks" in refused(tmp_path / name)
    assert "give the folder of the whole set" in refused(files[1])
    other = sorted(write(tmp_path / "other", seed=5).glob("0*.h5"))
    other[1].write_bytes(files[1].read_bytes())
    assert "is of another set than" in refused(tmp_path / "other")


def test_no_wrong_byte_goes_unnoticed(stored, small):
    whole = read_all(stored)
    for position in range(0, len(small), len(small) // 60):
        stored.write_bytes(small[:position] + bytes([small[position] ^ 0x55]) + small[position + 1 :])
        with suppress(UserError):  # some bytes say nothing
            found = read_all(stored)
            assert found[:2] == whole[:2]
            assert all(np.array_equal(*pair) for pair in zip(found[2:], whole[2:], strict=True))


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("format", "brushexp catalogue", "not one of brushexp strokes"),
        ("format", 3, "attribute format is"),
        ("format_version", 3, "has format_version 3, and this brushexp reads 2; update brushexp"),
        ("format_version", 0, "simulate it again"),
        ("format_version", "1", "attribute format_version is '1'; a whole number is needed"),
        ("first", -1, "first is -1"),
        ("first", 16, "begins at stroke 16"),
        ("n", 0, "n is 0 and window is 6"),
        ("n", 199, r"params has shape \(200, 10\); \(199, 10\) is needed"),
        ("n", 2.5, "attribute n is"),
        ("window", 7, r"images has shape \(200, 6, 6, 4\); \(200, 7, 7, 4\) is needed"),
        ("window", -6, "window is -6"),
        ("seed", "x", "attribute seed is 'x'; a whole number is needed"),
        ("engine", 5, "attribute engine is .*; text is needed"),
        ("engine_config", "{", "is damaged or cut short"),
        ("engine_config", "[1]", r"attribute engine_config is \[1\]; JSON"),
    ],
)
def test_a_wrong_attribute_is_explained(stored, name, value, message):
    with h5py.File(stored, "a") as file:
        file.attrs[name] = value
    assert re.search(message, refused(stored))


@pytest.mark.parametrize("name", ["format_version", "first", "n", "seed", "engine", "engine_config", "window"])
def test_a_missing_attribute_is_explained(stored, name):
    with h5py.File(stored, "a") as file:
        del file.attrs[name]
    assert f"has no attribute {name}" in refused(stored)


@pytest.mark.parametrize("name", ["params", "images", "heights"])
def test_a_missing_or_foreign_dataset_is_explained(stored, name):
    def replaced(unit: str | None, **dataset: object) -> str:
        with h5py.File(stored, "a") as file:
            if name in file:
                del file[name]
            if dataset:
                file.create_dataset(name, **dataset)[:100] = 0
            if unit is not None:
                file[name].attrs["unit"] = unit
        return refused(stored)

    with h5py.File(stored) as file:
        shape, kind = file[name].shape, file[name].dtype
    grows = {"chunks": (BLOCK, *shape[1:]), "maxshape": (None, *shape[1:])}
    assert f"has no dataset {name}" in replaced(None)
    assert f"dataset {name} has no attribute unit" in replaced(None, shape=shape, dtype=np.float64)
    assert f"{name} has type float64" in replaced("none", shape=shape, dtype=np.float64)
    assert f"{name} has chunks None" in replaced("none", shape=shape, dtype=kind)
    assert f"{name} has only 7 of its chunks; it is not complete" in replaced("none", shape=shape, dtype=kind, **grows)


@pytest.mark.parametrize("value", [1.5, np.nan])
def test_parameters_out_of_range_are_explained(stored, value):
    with h5py.File(stored, "a") as file:
        file["params"][70, 3] = value
    assert "params has numbers outside [-1, 1]" in refused(stored)
