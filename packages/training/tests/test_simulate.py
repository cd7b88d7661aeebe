"""Sets of strokes: the same whatever happens while they are made, never half a file; read as they were, or refused."""

import json
import os
import re
import resource
import signal
from functools import partial
from pathlib import Path

import catalogues
import h5py
import numpy as np
import pytest
import torch
from brushexp_training import datamodule, writer
from brushexp_training.datamodule import SimulatedData, StoredData
from brushexp_training.dataset import BLOCK, HEIGHT_STEPS, Origin, Split, StrokeSet, origin_of, pictures_of
from brushexp_training.evaluation import GAP_PIXELS, stroke_sheet
from brushexp_training.writer import BATCH_STROKES, shard_rows, simulate_set, to_rows
from program import disturb_move
from refusals import refuses
from torch import Tensor

from brushexp.plugins.engine.base import Engine, Simulated
from brushexp.registry import plugins
from brushexp.strokes.prior import parameters_of, sample_prior

MANY = 1000  # more than three groups of blocks, and the last block is short


SHARD_STROKES = 256  # in these tests, so that there are several


N = 5 * SHARD_STROKES + 70
ORIGIN = Origin("spot", {"radius": 0.25}, 6)  # as `write` has it


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


def write(path: Path, n: int = MANY, seed: int = 0, window: int = 6, engine: str = "spot", **config: object) -> Path:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(writer, "SHARD_STROKES", SHARD_STROKES)
        simulate_set(path, Spot(window), Origin(engine, {"radius": 0.25} | config, window), seed, n)
    return path


@pytest.fixture
def small_shards(monkeypatch) -> None:
    monkeypatch.setattr(writer, "SHARD_STROKES", SHARD_STROKES)


def contents(path: Path) -> dict[str, bytes]:
    """All shards of a set."""
    return {file.name: file.read_bytes() for file in path.glob("*.h5")}


class Killed(BaseException):
    """Ends a process at any line."""


class Breaking(Spot):
    """An engine that is killed after so many strokes."""

    def __init__(self, last: int) -> None:
        super().__init__()
        self.last = last

    def __call__(self, parameters, *, seed, first=0):
        if first >= self.last:
            raise Killed
        return super().__call__(parameters, seed=seed, first=first)


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> dict[str, bytes]:
    """A set that was made in one go."""
    return contents(write(tmp_path_factory.mktemp("whole") / "strokes", n=N))


@pytest.mark.parametrize("stops", [[0], [BATCH_STROKES], [300, 300, 1000], list(range(0, N - 70, 100))])
def test_a_set_made_in_pieces_is_the_same(tmp_path, small_shards, whole, stops):
    path = tmp_path / "strokes"
    for stop in stops:
        with pytest.raises(Killed):
            simulate_set(path, Breaking(stop), ORIGIN, 0, N)
        assert not stop or len(StrokeSet(path)) < N
    assert contents(write(path, n=N)) == whole
    for before in (3, SHARD_STROKES, 2 * SHARD_STROKES + 1, N - 1):
        path = write(tmp_path / f"{before}", n=before)
        assert len(StrokeSet(path)) == before
        assert contents(write(path, n=N)) == whole, "a set that grows is the same as one made large"


@pytest.mark.parametrize("after", [False, True])
@pytest.mark.parametrize("number", [1, 2, 6])
def test_a_set_that_is_killed_where_a_shard_takes_its_place_is_the_same(
    tmp_path, small_shards, whole, monkeypatch, number, after
):
    def kill() -> None:
        raise Killed

    path = tmp_path / "strokes"
    with monkeypatch.context() as patched:
        patched.setattr(os, "replace", os.replace)
        disturb_move(".h5", number, after, kill)
        with pytest.raises(Killed):
            simulate_set(path, Spot(), ORIGIN, 0, N)
    assert len(contents(path)) == number - 1 + after
    assert contents(write(path, n=N)) == whole


def test_ctrl_c_keeps_what_is_simulated(tmp_path, small_shards, monkeypatch):
    monkeypatch.setattr(writer, "BATCH_STROKES", 32)
    path = tmp_path / "strokes"

    class Pressing(Spot):
        def __call__(self, parameters, *, seed, first=0):
            if first == 64:
                signal.raise_signal(signal.SIGINT)
            return super().__call__(parameters, seed=seed, first=first)

    with pytest.raises(KeyboardInterrupt):
        simulate_set(path, Pressing(), ORIGIN, 0, N)
    assert len(StrokeSet(path)) == 96
    assert simulate_set(path, Spot(), ORIGIN, 0, N) == N - 96
    assert simulate_set(path, Spot(), ORIGIN, 0, N) == 0


def test_what_killed_runs_leave_behind_does_no_harm_and_only_one_run_makes_a_set_at_a_time(tmp_path, whole, caplog):
    path = write(tmp_path / "strokes", n=N)
    (path / ".brushexp-abcd.h5").write_bytes(b"half")
    files = sorted(path.glob("0*.h5"))
    files[1].write_bytes(files[1].read_bytes()[:3000])
    files[2].unlink()
    assert contents(write(path, n=N)) == whole
    assert "it is made again" in caplog.text

    def again(*_: object, **__: object) -> Simulated:
        return simulate_set(tmp_path, Spot(), ORIGIN, 0, N)

    refuses("is being made by another run", simulate_set, tmp_path, again, ORIGIN, 0, N)
    assert simulate_set(tmp_path, Spot(), ORIGIN, 0, 40) == 40


@pytest.mark.parametrize(("origin", "seed", "n", "message"), [
    (Origin("blot", {"radius": 0.25}, 6), 0, N, "was made with engine=spot, this run has engine=blot"),
    (Origin("spot", {"radius": 0.5}, 6), 0, N, "engine.radius=0.25, this run has engine.radius=0.5"),
    (Origin("spot", {"radius": 0.25, "load": 1}, 6), 0, N, "no engine.load, this run has engine.load=1"),
    (Origin("spot", {"radius": 0.25}, 7), 0, N, "the window=6, this run has the window=7"),
    (ORIGIN, 1, N, "seed=0, this run has seed=1"),
    (ORIGIN, 0, 200, "already, more than n=200"),
])  # fmt: skip
def test_a_set_is_not_continued_with_other_settings(tmp_path, origin, seed, n, message):
    path = write(tmp_path / "strokes", n=300)
    before = contents(path)
    refuses(message, simulate_set, path, Spot(), origin, seed, n)
    assert contents(path) == before, "nothing was lost"


@pytest.mark.parametrize("room", [2000, 30_000])
def test_a_full_disk_or_a_file_in_the_way_ends_in_one_clear_line_and_nothing_is_lost(tmp_path, whole, room):
    path = write(tmp_path / "strokes", n=SHARD_STROKES)
    small = contents(path)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (room, hard))
    try:
        refuses(rf"cannot write {path}/.*with path=", write, path, n=N)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert contents(path) == small
    assert contents(write(path, n=N)) == whole
    file = path / "000000000.h5"
    for place in (file, file / "a"):
        refuses(r"cannot write .*; .*path=", simulate_set, place, Spot(), ORIGIN, 0, N)
    assert contents(path) == whole


def test_numbers_that_are_not_finite_are_refused_with_the_stroke_and_others_are_clipped():
    simulated = Spot()(torch.zeros(9, 10), seed=0)
    simulated.heights[7, 2, 3] = torch.nan
    refuses("the engine drew stroke 107 with numbers that are not finite", to_rows, torch.zeros(9, 10), simulated, 100)
    images = torch.tensor([-1.0, 2.0, 0.5])[:, None, None, None].expand(3, 4, 6, 6)
    heights = torch.tensor([-1.0, 1e6, 0.5])[:, None, None].expand(3, 6, 6)
    rows = to_rows(torch.zeros(3, 10), Simulated(images, heights), 0)
    assert rows["images"][:, 0, 0, 0].tolist() == [0, 255, 128]
    assert (rows["heights"][:, 0, 0] / 1024).tolist() == [0, 65535 / 1024, 0.5]
    assert rows["heights"].dtype == np.uint16


def test_the_sheet_shows_strokes_over_white():
    images = torch.zeros(13, 4, 6, 6)
    images[:, 0] = 1
    images[12, 3] = 1  # red; the others are clear
    sheet = stroke_sheet(images, 10)
    pitch = 6 * 21 + GAP_PIXELS
    assert sheet.shape == (3, 2 * pitch + GAP_PIXELS, 10 * pitch + GAP_PIXELS)
    assert sheet[:, GAP_PIXELS, GAP_PIXELS].tolist() == [1, 1, 1]
    assert sheet[:, pitch + GAP_PIXELS, 2 * pitch + GAP_PIXELS].tolist() == [1, 0, 0]


@pytest.fixture(scope="module")
def large(tmp_path_factory) -> Path:
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
    assert (orders[0][1:] - orders[0][:-1] == 1).float().mean() < 0.05, "neighbours are apart"
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
    assert next(iter(eight.val_dataloader())).images is held_out[0][0].images, "they are simulated once"
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
        assert "simulate again what it lacks" in refused(tmp_path / name)
    assert "give the folder of the whole set" in refused(files[1])
    other = sorted(write(tmp_path / "other", seed=5).glob("0*.h5"))
    other[1].write_bytes(files[1].read_bytes())
    assert "is of another set than" in refused(tmp_path / "other")
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
    ("engine_config", "[1]", r"attribute engine_config is \[1\]; JSON"),
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
    assert f"{name} has chunks None" in replaced("none", shape=shape, dtype=kind)
    assert f"{name} has only 7 of its chunks; it is not complete" in replaced("none", shape=shape, dtype=kind, **grows)
