"""Test that sets are read back unchanged, that loaders yield every stroke once, and that damaged files are refused."""

import json
import re
from functools import partial
from pathlib import Path

import catalogues
import h5py
import numpy as np
import pytest
import torch
from brushexp_training.stroke_sets import datamodule, writer
from brushexp_training.stroke_sets.datamodule import SimulatedData, StoredData
from brushexp_training.stroke_sets.dataset import BLOCK, HEIGHT_STEPS, Origin, Split, StrokeSet, origin_of, pictures_of
from brushexp_training.stroke_sets.writer import shard_rows, simulate_set
from refusals import refuses
from torch import Tensor

from brushexp.plugins.engine.base import Engine, Simulated
from brushexp.registry import plugins
from brushexp.strokes.prior import parameters_of, sample_prior

MANY = 1000  # more than three groups of blocks, with a short last block


SHARD_STROKES = 256  # small, so that these tests have several shards


N = 5 * SHARD_STROKES + 70


class Spot(Engine):
    """An engine that draws waves in the stroke's colour; their phase depends on the stroke's number and the seed."""

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


def write(path: Path, n: int = MANY, seed: int = 0, window: int = 6, engine: str = "spot", **config: object) -> Path:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(writer, "SHARD_STROKES", SHARD_STROKES)
        simulate_set(path, Spot(window), Origin(engine, {"radius": 0.25} | config, window), seed, n)
    return path


@pytest.fixture(scope="module")
def large(tmp_path_factory) -> Path:
    return write(tmp_path_factory.mktemp("set") / "strokes")


@pytest.fixture(scope="module")
def small(tmp_path_factory) -> bytes:
    """Return the bytes of a set that consists of one shard."""
    return (write(tmp_path_factory.mktemp("set") / "small", n=200) / "000000000.h5").read_bytes()


@pytest.fixture
def stored(small, tmp_path) -> Path:
    path = tmp_path / "strokes.h5"
    path.write_bytes(small)
    return path


def split_of(n: int, split: Split) -> np.ndarray:
    return split.places(np.arange(n))


def read_all(path: Path) -> tuple:
    strokes = StrokeSet(path)
    rows = [shard_rows(shard) for shard in strokes.shards]
    for shard in strokes.shards:
        shard.file.close()
    return strokes.origin, strokes.seed, *(np.concatenate([row[name] for row in rows]) for name in rows[0])


refused = partial(catalogues.refused, read=read_all)


def numbers_of(loader) -> Tensor:
    return torch.cat([batch.number for batch in loader])


def test_a_set_comes_back_as_it_was_simulated(large):
    strokes = StrokeSet(large)
    parameters = parameters_of(sample_prior(MANY))
    simulated = Spot()(parameters, seed=0)
    assert (len(strokes), strokes.origin, strokes.seed) == (MANY, Origin("spot", {"radius": 0.25}, 6), 0)
    assert [len(shard) for shard in strokes.shards] == [256, 256, 256, 232]
    _, _, read, _, heights = read_all(large)
    assert torch.equal(torch.from_numpy(read), parameters)
    np.testing.assert_allclose(heights / HEIGHT_STEPS, simulated.heights, rtol=0, atol=0.6 / HEIGHT_STEPS)
    numbers = np.array([3, 999, 0, 500, 17, 16, 255, 256, 15])
    images = torch.from_numpy(pictures_of(strokes.shards, numbers)).permute(0, 3, 1, 2) / 255
    torch.testing.assert_close(images, simulated.images[numbers], rtol=0, atol=0.5 / 255 + 1e-6)
    attributes = {"format", "format_version", "first", "n", "seed", "engine", "engine_config", "window", "splits"}
    assert set(strokes.shards[1].file.attrs) == attributes
    assert all(dataset.fletcher32 and len(dataset.attrs["unit"]) for dataset in strokes.shards[1].file.values())


@pytest.mark.parametrize("n", [1, 33, 1000, 5003])
def test_splits_share_out_all_strokes_and_keep_them_when_the_set_grows(n):
    numbers = {split: split_of(n, split) for split in Split}
    assert sorted(np.concatenate(list(numbers.values()))) == list(range(n))
    for split, places in numbers.items():
        assert np.array_equal(split_of(n + 777, split)[: len(places)], places)
        if n > 5000 and split is not Split.TRAINING:
            assert 0.04 < len(places) / n < 0.06


@pytest.mark.parametrize("batch_size", [7, 64, 5000])
def test_every_training_stroke_comes_once_in_an_epoch_and_in_another_order_in_the_next(large, batch_size):
    loader = StoredData([large], batch_size=batch_size).train_dataloader()
    epochs = [list(loader), list(loader)]
    orders = [numbers_of(epoch) for epoch in epochs]
    for epoch, order in zip(epochs, orders, strict=True):
        assert len(epoch) == len(loader)
        assert torch.equal(order.sort().values, torch.from_numpy(split_of(MANY, Split.TRAINING)))
    assert not torch.equal(*orders)
    assert (orders[0][1:] - orders[0][:-1] == 1).float().mean() < 0.05, "neighbours are separated"
    again, other = (StoredData([large], batch_size=batch_size, seed=seed).train_dataloader() for seed in (0, 1))
    assert torch.equal(numbers_of(again), orders[0])
    assert not torch.equal(numbers_of(other), orders[0])


@pytest.mark.parametrize("last", [0, 9, 23])
def test_a_loader_goes_on_where_it_was(large, last):
    whole, first, second = (StoredData([large], batch_size=37).train_dataloader() for _ in range(3))
    numbers = [batch.number for _ in range(2) for batch in whole]
    assert len(whole) == 24
    for _ in zip(range(last + 1), first, strict=False):
        pass
    second.load_state_dict(first.state_dict())
    going_on = [batch.number for _ in range(2) for batch in second][: len(numbers) - last - 1]
    assert all(torch.equal(*pair) for pair in zip(going_on, numbers[last + 1 :], strict=False))


def test_several_sets_are_read_as_one_and_limit_takes_the_first_training_strokes(large, tmp_path):
    data = StoredData([large], batch_size=10, limit=50)
    assert sorted(numbers_of(data.train_dataloader()).tolist()) == split_of(MANY, Split.TRAINING)[:50].tolist()
    for loader, split in ((data.val_dataloader(), Split.VALIDATION), (data.test_dataloader(), Split.TEST)):
        for _ in range(2):
            assert numbers_of(loader).tolist() == split_of(MANY, split).tolist()
    assert [data.count(Split.TEST, most) for most in (None, 20, 80)] == [64, 20, 64]
    assert [len(batch.number) for batch in data.first(Split.TEST, 15)] == [10, 5]
    assert torch.equal(data.first_batch(Split.TEST, 15).number, torch.arange(15))
    data = StoredData([large, write(tmp_path / "other", n=400, seed=1)], batch_size=50)
    for split, loader in ((Split.TRAINING, data.train_dataloader()), (Split.TEST, data.test_dataloader())):
        expected = set()
        for size, seed in ((MANY, 0), (400, 1)):
            parameters = parameters_of(sample_prior(size, seed))
            levels = (Spot()(parameters, seed=seed).images * 255 + 0.5).to(torch.uint8) / 255
            expected |= {row_of(parameters[n], levels[n], n) for n in split_of(size, split)}
        assert {row_of(*row) for batch in loader for row in zip(*batch, strict=True)} == expected


def row_of(parameters: Tensor, image: Tensor, number: int) -> tuple[float, ...]:
    return (int(number), *parameters.tolist(), *image.flatten().tolist())


def test_sets_that_do_not_fit_together_are_refused(large, tmp_path):
    small = write(tmp_path / "d", n=BLOCK)
    for paths, limit, message in (
        ([large, write(tmp_path / "a", n=40, window=8)], None, r"window 6, and .* has window 8; give sets that agree"),
        ([large, write(tmp_path / "b", n=40, engine="blot")], None, r"engine spot, and .* has engine blot"),
        ([large, write(tmp_path / "c", n=40)], None, r"hold the same strokes \(seed 0\)"),
        ([], None, "no set of strokes is given"),
        ([small], None, "no stroke is for validation"),
        ([large], 0, "set limit to 1 or more"),
    ):
        refuses(message, StoredData, paths, limit=limit)


def test_an_engine_simulates_no_stroke_twice_in_batches_of_any_size_and_its_origin_is_all_of_its_options(
    config, monkeypatch
):
    monkeypatch.setattr(datamodule, "EPOCH_STEPS", 4)

    def data(batch_size: int) -> SimulatedData:
        return SimulatedData(Spot(), Origin("spot", {}, 6), batch_size=batch_size, seed=3, held_out=25)

    eight = data(8)
    loader = eight.train_dataloader()
    assert torch.equal(torch.cat([numbers_of(loader), numbers_of(loader)]), torch.arange(64))
    held_out = [list(eight.val_dataloader()), list(eight.test_dataloader())]
    assert all([len(batch.number) for batch in batches] == [8, 8, 8, 1] for batches in held_out)
    assert numbers_of(held_out[0]).min() > 2**39
    assert not set(numbers_of(held_out[0]).tolist()) & set(numbers_of(held_out[1]).tolist())
    assert next(iter(eight.val_dataloader())).images is held_out[0][0].images, "they are simulated only once"
    few, many = (torch.cat([batch.images for batch in data(size).train_dataloader()]) for size in (4, 8))
    torch.testing.assert_close(few, many[:16])
    for plugin in plugins("engine"):
        node = config("task=simulate", f"engine={plugin.name}").engine
        origin = origin_of(node, Spot())
        assert origin.engine == plugin.name
        assert {"_target_", *origin.engine_config} == set(node)
        assert json.loads(json.dumps(origin.engine_config)) == origin.engine_config


def test_what_is_no_set_and_parameters_out_of_range_are_explained(tmp_path, stored):
    assert "make one with brushexp task=simulate" in refused(tmp_path / "nowhere")
    (tmp_path / "empty").mkdir()
    assert "there is no set of strokes at" in refused(tmp_path / "empty")
    path = tmp_path / "a.h5"
    assert "not one of brushexp strokes" in catalogues.refused_if_foreign(path, refused)
    for share in (0.1, 0.5, 0.9, 0.999):
        path.write_bytes(stored.read_bytes()[: int(stored.stat().st_size * share)])
        assert "is damaged or cut short" in refused(path)
    for value in (1.5, np.nan):
        with h5py.File(stored, "a") as file:
            file["params"][70, 3] = value
        assert "params has numbers outside [-1, 1]" in refused(stored)


def test_no_wrong_byte_goes_unnoticed_and_shards_that_are_not_a_whole_set_are_refused(large, tmp_path, stored):
    files = sorted(large.glob("0*.h5"))
    for name, chosen in (("gap", [files[0], files[2]]), ("end", files[1:])):
        (tmp_path / name).mkdir()
        for path in chosen:
            (tmp_path / name / path.name).write_bytes(path.read_bytes())
        assert "simulate the missing strokes again" in refused(tmp_path / name)
    assert "give the folder of the whole set" in refused(files[1])
    other = sorted(write(tmp_path / "other", seed=5).glob("0*.h5"))
    other[1].write_bytes(files[1].read_bytes())
    assert "belongs to a different set than" in refused(tmp_path / "other")
    whole = read_all(stored)

    def unchanged() -> None:
        contents = read_all(stored)
        assert contents[:2] == whole[:2]
        assert all(np.array_equal(*pair) for pair in zip(contents[2:], whole[2:], strict=True))

    catalogues.spoil_every(stored, stored.stat().st_size // 40, unchanged)


@pytest.mark.parametrize(("name", "value", "message"), [
    ("format", "brushexp catalogue", "not one of brushexp strokes"),
    ("format_version", 3, "has format_version 3, and this brushexp reads 2; update brushexp"),
    ("format_version", 0, "simulate it again"),
    ("first", -1, "first is -1"),
    ("first", 16, "begins at stroke 16"),
    ("n", 0, "n is 0 and window is 6"),
    ("n", 199, r"params has shape \(200, 10\); \(199, 10\) is needed"),
    ("window", 7, r"images has shape \(200, 6, 6, 4\); \(200, 7, 7, 4\) is needed"),
    ("window", -6, "window is -6"),
    ("engine", 5, "attribute engine is .*; text is needed"),
    ("engine_config", "{", "attribute engine_config is not JSON"),
    ("engine_config", "[1]", r"attribute engine_config is \[1\], not JSON"),
    *((name, None, f"has no attribute {name}") for name in ("first", "n", "seed", "engine", "window")),
])  # fmt: skip
def test_a_wrong_or_missing_attribute_is_explained(stored, name, value, message):
    catalogues.give_attribute(stored, name, value)
    assert re.search(message, refused(stored))


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
    cure = "simulate it again or give another one"
    assert f"{name} has chunks None, not of {BLOCK} strokes; {cure}" in replaced("none", shape=shape, dtype=kind)
    lacking = replaced("none", shape=shape, dtype=kind, **grows)
    assert f"{name} has only 7 of its {-(-shape[0] // BLOCK)} chunks; {cure}" in lacking
