"""A set of strokes comes back from disk as it was; loaders hand out every stroke once; what is damaged is refused."""

import json
import re
from contextlib import closing, suppress
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
from brushexp.training.dataset import BLOCK, HEIGHT_STEPS, Origin, Split, StrokeFile, origin_of, require_same_origin
from brushexp.training.recording import Recording
from brushexp.training.stream import OnTheWay, StrokeData

N = 1000  # more than three groups of blocks, and the last block is short


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
    with Recording(path, Origin(engine, {"radius": 0.25} | config, window), seed, n) as recording:
        for first, size in recording.batches():
            parameters = parameters_of(sample_prior(size, seed, first))
            recording.add(parameters, Spot(window)(parameters, seed=seed, first=first))
        recording.finish()
    return path


@pytest.fixture(scope="module")
def kept(tmp_path_factory) -> Path:
    return write(tmp_path_factory.mktemp("set") / "strokes.h5")


@pytest.fixture
def stored(kept, tmp_path) -> Path:
    path = tmp_path / "strokes.h5"
    path.write_bytes(kept.read_bytes())
    return path


def read_all(path: Path) -> tuple:
    with closing(StrokeFile(path)) as file:
        numbers = np.arange(len(file))
        return file.origin, file.seed, file.parameters, file.pictures(numbers), file.heights(numbers)


def refused(path: Path) -> str:
    """The message with which reading all of it is refused: one line that names the file once."""
    with pytest.raises(UserError) as caught:
        read_all(path)
    message = str(caught.value)
    assert "\n" not in message
    assert str(path) in message
    assert str(path) + ": " + str(path) not in message
    return message


def test_a_set_comes_back_as_it_was_simulated(kept):
    file = StrokeFile(kept)
    parameters = parameters_of(sample_prior(N))
    simulated = Spot()(parameters, seed=0)
    assert (len(file), file.window, file.engine, file.engine_config, file.seed) == (N, 6, "spot", {"radius": 0.25}, 0)
    torch.testing.assert_close(file.parameters, parameters, rtol=0, atol=0)
    numbers = np.array([3, 999, 0, 500, 17, 16, 15])
    images = torch.from_numpy(file.pictures(numbers)).permute(0, 3, 1, 2) / 255
    torch.testing.assert_close(images, simulated.images[numbers], rtol=0, atol=0.5 / 255 + 1e-6)
    torch.testing.assert_close(file.heights(numbers), simulated.heights[numbers], rtol=0, atol=0.6 / HEIGHT_STEPS)


def test_the_file_says_what_it_is(kept):
    with h5py.File(kept) as file:
        assert {"format", "format_version", "n", "seed", "engine", "engine_config", "window", "splits"} == set(
            file.attrs
        )
        for dataset in file.values():
            assert dataset.fletcher32
            assert len(dataset.attrs["unit"])


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
    data = StrokeData([kept], batch_size=batch_size, prefetch=prefetch)
    loader = data.train_dataloader()
    epochs = [list(loader), list(loader)]
    numbers = [torch.cat([batch.number for batch in epoch]) for epoch in epochs]
    expected = torch.from_numpy(Split.TRAINING.numbers(N))
    for epoch, order in zip(epochs, numbers, strict=True):
        assert len(epoch) == len(loader)
        assert torch.equal(order.sort().values, expected)
    assert not torch.equal(*numbers)
    assert (numbers[0][1:] - numbers[0][:-1] == 1).float().mean() < 0.05, "neighbours are apart"


def test_rows_of_a_batch_belong_together(kept):
    batch = next(iter(StrokeData([kept], batch_size=33).train_dataloader()))
    assert batch.parameters.shape == (33, 10)
    assert batch.images.shape == (33, 4, 6, 6)
    assert (batch.images.dtype, batch.number.dtype) == (torch.float32, torch.int64)
    parameters = parameters_of(sample_prior(N))[batch.number]
    torch.testing.assert_close(batch.parameters, parameters, rtol=0, atol=0)
    expected = Spot()(parameters_of(sample_prior(N)), seed=0).images[batch.number]
    torch.testing.assert_close(batch.images, expected, rtol=0, atol=0.5 / 255 + 1e-6)


def test_seed_and_epoch_decide_the_order(kept):
    def order(seed: int, epoch: int) -> Tensor:
        loader = StrokeData([kept], seed=seed).train_dataloader()
        loader.set_epoch(epoch)
        return torch.cat([batch.number for batch in loader])

    assert torch.equal(order(1, 4), order(1, 4))
    assert not torch.equal(order(1, 4), order(1, 5))
    assert not torch.equal(order(1, 4), order(2, 4))


@pytest.mark.parametrize("seen", [0, 1, 9, 23])
def test_a_loader_goes_on_where_it_was(kept, seen):
    whole = StrokeData([kept], batch_size=37).train_dataloader()
    numbers = [batch.number for _ in range(2) for batch in whole]
    assert len(whole) == 24
    first = StrokeData([kept], batch_size=37).train_dataloader()
    batches = iter(first)
    for _ in range(seen + 1):
        next(batches)
    second = StrokeData([kept], batch_size=37).train_dataloader()
    second.load_state_dict(first.state_dict())
    going_on = [batch.number for _ in range(2) for batch in second][: len(numbers) - seen - 1]
    assert all(torch.equal(*pair) for pair in zip(going_on, numbers[seen + 1 :], strict=False))


def test_limit_takes_the_first_training_strokes_and_leaves_the_others(kept):
    data = StrokeData([kept], limit=50)
    numbers = torch.cat([batch.number for batch in data.train_dataloader()])
    assert sorted(numbers.tolist()) == Split.TRAINING.numbers(N)[:50].tolist()
    held_out = torch.cat([batch.number for batch in data.val_dataloader()])
    assert held_out.tolist() == Split.VALIDATION.numbers(N).tolist()


def test_held_out_strokes_come_in_order_and_apart(kept):
    data = StrokeData([kept], batch_size=10)
    for loader, split in ((data.val_dataloader(), Split.VALIDATION), (data.test_dataloader(), Split.TEST)):
        for _ in range(2):
            assert torch.cat([batch.number for batch in loader]).tolist() == split.numbers(N).tolist()


def test_several_files_are_read_as_one(kept, tmp_path):
    other = write(tmp_path / "other.h5", n=400, seed=1)
    data = StrokeData([kept, other], batch_size=50)
    batches = list(data.train_dataloader())
    expected = np.concatenate([Split.TRAINING.numbers(N), Split.TRAINING.numbers(400)])
    assert sorted(torch.cat([batch.number for batch in batches]).tolist()) == sorted(expected.tolist())
    rows = {tuple(row) for batch in batches for row in batch.parameters.tolist()}
    found = [parameters_of(sample_prior(n, seed))[Split.TRAINING.numbers(n)] for n, seed in ((N, 0), (400, 1))]
    assert rows == {tuple(row) for row in torch.cat(found).tolist()}
    assert len(torch.cat([batch.number for batch in data.test_dataloader()])) == sum(
        len(Split.TEST.numbers(n)) for n in (N, 400)
    )


def test_files_that_do_not_fit_together_are_refused(kept, tmp_path):
    with pytest.raises(UserError, match=r"window 6, and .* has window 8; give files that agree"):
        StrokeData([kept, write(tmp_path / "a.h5", n=40, window=8)])
    with pytest.raises(UserError, match=r"engine spot, and .* has engine blot"):
        StrokeData([kept, write(tmp_path / "b.h5", n=40, engine="blot")])
    with pytest.raises(UserError, match=r"hold the same strokes \(seed 0\)"):
        StrokeData([kept, write(tmp_path / "c.h5", n=40)])
    with pytest.raises(UserError, match="no file of strokes is given"):
        StrokeData([])
    with pytest.raises(UserError, match="no stroke is for validation"):
        StrokeData([write(tmp_path / "d.h5", n=BLOCK)])
    with pytest.raises(UserError, match="set limit to 1 or more"):
        StrokeData([kept], limit=0)


def test_on_the_way_no_stroke_comes_twice_and_the_batch_size_changes_none():
    def source() -> OnTheWay:
        return OnTheWay(Spot(), Origin("spot", {}, 6), seed=3, steps=4, held_out=25)

    data = StrokeData(source(), batch_size=8)
    loader = data.train_dataloader()
    numbers = torch.cat([batch.number for _ in range(2) for batch in loader])
    assert torch.equal(numbers, torch.arange(64))
    for held_out in (data.val_dataloader(), data.test_dataloader()):
        batches = list(held_out)
        assert [len(batch.number) for batch in batches] == [8, 8, 8, 1]
        assert torch.cat([batch.number for batch in batches]).min() > 2**39
        assert torch.equal(list(held_out)[1].images, batches[1].images)
    few = torch.cat([batch.images for batch in StrokeData(source(), batch_size=4).train_dataloader()])
    many = torch.cat([batch.images for batch in StrokeData(source(), batch_size=8).train_dataloader()])
    torch.testing.assert_close(few, many[:16])
    with pytest.raises(UserError, match="drop limit"):
        StrokeData(source(), limit=5)


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
    def fit(steps: int, checkpoint: Path | None = None) -> tuple[Mean, L.Trainer]:
        module = Mean()
        trainer = L.Trainer(
            accelerator="cpu",
            max_steps=steps,
            logger=False,
            enable_checkpointing=False,
            enable_progress_bar=False,
            enable_model_summary=False,
            default_root_dir=tmp_path,
        )
        trainer.fit(module, StrokeData([kept], batch_size=100), ckpt_path=checkpoint)
        return module, trainer

    whole, _ = fit(14)
    begun, trainer = fit(5)
    trainer.save_checkpoint(tmp_path / "a.ckpt")
    rest, _ = fit(14, tmp_path / "a.ckpt")
    assert begun.seen + rest.seen == whole.seen


def test_a_set_of_another_brush_is_refused():
    ours = Origin("fluid", {"load": 0.8, "frames": 20}, 64)
    require_same_origin(ours, Origin("fluid", {"frames": 20, "load": 0.8}, 64), "a.h5")
    for theirs, message in (
        (Origin("dabs", {}, 64), "a.h5 was made with engine=dabs, .* made with engine=fluid"),
        (Origin("fluid", {"load": 0.5, "frames": 20}, 64), "with engine.load=0.5, .* with engine.load=0.8"),
        (Origin("fluid", {"frames": 20}, 64), "with no engine.load, .* with engine.load=0.8"),
        (Origin("fluid", {"load": 0.8, "frames": 20}, 128), "with the window=128, .* with the window=64"),
    ):
        with pytest.raises(UserError, match=message):
            require_same_origin(ours, theirs, "a.h5")


def test_the_origin_of_an_engine_is_all_of_its_options(config):
    for plugin in plugins("engine"):
        node = config("task=simulate", f"engine={plugin.name}").engine
        origin = origin_of(node, Spot())
        assert origin.engine == plugin.name
        assert {"_target_", *origin.engine_config} == set(node)
        assert json.loads(json.dumps(origin.engine_config)) == origin.engine_config


def test_a_missing_file_is_explained(tmp_path):
    assert "make one with python run.py task=simulate" in refused(tmp_path / "a.h5")


def test_for_a_folder_the_file_in_it_is_proposed(tmp_path):
    assert str(tmp_path / "strokes.h5") in refused(tmp_path)


@pytest.mark.parametrize("data", [b"", b"\x89PNG\r\n\x1a\n" + bytes(3000), b"x" * 5000])
def test_a_file_of_another_kind_is_explained(tmp_path, data):
    path = tmp_path / "a.h5"
    path.write_bytes(data)
    assert "not an HDF5 file" in refused(path)


def test_another_hdf5_file_is_explained(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["params"] = np.zeros((3, 10))
    assert "not one of brushexp strokes" in refused(tmp_path / "a.h5")


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9, 0.999])
def test_a_truncated_file_is_explained(stored, share):
    data = stored.read_bytes()
    stored.write_bytes(data[: int(len(data) * share)])
    assert "is damaged or cut short" in refused(stored)


def test_no_wrong_byte_goes_unnoticed(stored, kept):
    data = stored.read_bytes()
    whole = read_all(kept)
    for position in range(0, len(data), len(data) // 60):
        stored.write_bytes(data[:position] + bytes([data[position] ^ 0x55]) + data[position + 1 :])
        with suppress(UserError):  # some bytes say nothing
            found = read_all(stored)
            assert found[:2] == whole[:2]
            assert all(np.array_equal(*pair) for pair in zip(found[2:], whole[2:], strict=True))


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("format", "brushexp catalogue", "not one of brushexp strokes"),
        ("format", 3, "attribute format is"),
        ("format_version", 2, "has format_version 2, and this brushexp reads 1; update brushexp"),
        ("format_version", 0, "simulate it again"),
        ("format_version", "1", "attribute format_version is '1'; a whole number is needed"),
        ("n", 0, "n is 0 and window is 6"),
        ("n", 999, r"params has shape \(1000, 10\); \(999, 10\) is needed"),
        ("n", 10**15, "params has shape"),
        ("n", 2.5, "attribute n is"),
        ("window", 7, r"images has shape \(1000, 6, 6, 4\); \(1000, 7, 7, 4\) is needed"),
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


@pytest.mark.parametrize("name", ["format_version", "n", "seed", "engine", "engine_config", "window"])
def test_a_missing_attribute_is_explained(stored, name):
    with h5py.File(stored, "a") as file:
        del file.attrs[name]
    assert f"has no attribute {name}" in refused(stored)


@pytest.mark.parametrize("name", ["params", "images", "heights"])
def test_a_missing_or_foreign_dataset_is_explained(stored, name):
    with h5py.File(stored, "a") as file:
        shape, kind = file[name].shape, file[name].dtype
        del file[name]
    assert f"has no dataset {name}" in refused(stored)
    with h5py.File(stored, "a") as file:
        file[name] = np.zeros(shape, np.float64)
    assert f"dataset {name} has no attribute unit" in refused(stored)
    with h5py.File(stored, "a") as file:
        file[name].attrs["unit"] = "none"
    assert f"{name} has type float64" in refused(stored)
    with h5py.File(stored, "a") as file:
        del file[name]
        file[name] = np.zeros(shape, kind)
        file[name].attrs["unit"] = "none"
    assert f"{name} has chunks None" in refused(stored)
    with h5py.File(stored, "a") as file:
        del file[name]
        file.create_dataset(name, shape, kind, chunks=(BLOCK, *shape[1:]), maxshape=(None, *shape[1:]))[:500] = 0
        file[name].attrs["unit"] = "none"
    assert f"{name} has only 32 of its chunks; it is not complete" in refused(stored)


@pytest.mark.parametrize("value", [1.5, np.nan])
def test_parameters_out_of_range_are_explained(stored, value):
    with h5py.File(stored, "a") as file:
        file["params"][70, 3] = value
    assert "params has numbers outside [-1, 1]" in refused(stored)
