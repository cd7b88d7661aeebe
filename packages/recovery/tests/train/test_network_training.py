"""Test that the network learns from crops of a pool of paintings, and is validated against known strokes."""

import os
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from brushexp_recovery.model.channels import AFFINITY_OFFSETS, CHANNELS, PAINT, StrokeAttribute
from brushexp_recovery.model.recovery_model import RecoveryModel
from brushexp_recovery.synthesis import pool as pool_of_paintings
from brushexp_recovery.synthesis.pool import save_painting
from brushexp_recovery.train import data
from brushexp_recovery.train.crops import Crops, batch_of, cut_crop
from brushexp_recovery.train.data import FIRST_HELD_OUT, VALIDATED, RecoveryData
from brushexp_recovery.train.module import RecoveryModule
from brushexp_recovery.train.validation import Counts, count_strokes
from recovery_scenes import bars

from brushexp.errors import UserError

SURE = 6.0  # log-odds


def test_learning_lowers_the_loss():
    module = RecoveryModule(RecoveryModel().network, 1e-3)
    batch = batch_of([cut_crop(bars(), np.random.default_rng(0), 64)])
    optimizer = torch.optim.Adam(module.network.parameters(), 1e-3)
    losses = []
    for _ in range(6):
        loss = module.training_step(batch, 0)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        losses.append(loss.item())
    assert losses[-1] < losses[0]


@pytest.mark.parametrize(
    ("is_trained", "progress", "keeps"), [(True, 0.0, True), (False, 0.1, False), (False, 0.9, True)]
)
def test_normalisations_keep_their_statistics_once_they_are_settled(is_trained, progress, keeps, monkeypatch):
    monkeypatch.setattr(RecoveryModule, "progress", property(lambda _: progress))
    module = RecoveryModule(RecoveryModel().network, 1e-3, is_trained)
    before = {name: value.clone() for name, value in module.network.named_buffers()}
    module.on_train_batch_start()
    module.network(torch.rand(2, 3, 64, 64))
    same = [torch.equal(value, before[name]) for name, value in module.network.named_buffers()]
    assert all(same) == keeps


@torch.no_grad()
def test_figures_of_a_validation_are_means_over_its_batches(monkeypatch):
    monkeypatch.setattr(RecoveryModule, "global_step", property(lambda _: 3))
    module = RecoveryModule(RecoveryModel().network, 1e-3).eval()
    batches = [batch_of([cut_crop(bars(), np.random.default_rng(seed), 64)]) for seed in range(2)]
    figures = []
    for batch in batches:
        module.validation_step(batch, 0)
        figures.append(module.figures)
    for number, batch in enumerate(batches):
        module.validation_step(batch, number)
    for name, value in module.figures.items():
        if name != "f1_affinity":
            assert value == pytest.approx(np.mean([one[name] for one in figures])), name


@pytest.fixture
def pool(tmp_path) -> RecoveryData:
    """Make a pool with three training paintings and the held-out paintings for validation."""
    for number in [*range(3), *range(FIRST_HELD_OUT, FIRST_HELD_OUT + VALIDATED)]:
        save_painting(tmp_path / f"{number:06d}.npz", bars(0.1 * (number % 10)))
    return RecoveryData(tmp_path, ["coffee"], 5, 2, 3, 1)


def equal(one: Crops, other: Crops) -> bool:
    return all(torch.equal(a, b) for a, b in zip(one, other, strict=True))


def test_the_crops_of_a_step_depend_on_the_seed_and_the_step(pool):
    assert equal(pool.batch(4), pool.batch(4))
    assert not equal(pool.batch(4), pool.batch(5))
    batches = iter(pool.train_dataloader())
    assert equal(next(batches), pool.batch(0))
    assert equal(next(batches), pool.batch(1))
    batches.close()
    assert len(pool.loaded) == 3
    assert len(list(pool.val_dataloader())) == VALIDATED


def test_paintings_that_no_process_makes_are_not_waited_for(pool, monkeypatch):
    monkeypatch.setattr(data.subprocess, "Popen", lambda *_, **__: SimpleNamespace(poll=lambda: 1, terminate=int))
    pool.start_painting()
    assert len(pool.processes) == 2  # one for training paintings, one for held-out paintings
    assert len(pool.held_out_paintings(VALIDATED)) == VALIDATED
    with pytest.raises(UserError, match="no paintings can be made for training"):
        pool.held_out_paintings(VALIDATED + 1)
    pool.teardown("fit")
    assert not pool.processes


@pytest.fixture
def families_of_paintings(monkeypatch) -> list[str | None]:
    """Record the family of each new painting; only paintings 0 and 2 and the second held-out painting have one."""
    families, made = {0: "dabs", FIRST_HELD_OUT + 1: "dabs", 2: "washes"}, []
    monkeypatch.setattr(pool_of_paintings, "family_of", lambda _, number: families.get(number))
    monkeypatch.setattr(pool_of_paintings, "paint", lambda *words: made.append(words[-1]) or bars())
    return made


EVERY = (*range(3), *range(FIRST_HELD_OUT, FIRST_HELD_OUT + 3))


def test_paintings_of_families_that_are_left_out_are_neither_made_nor_learnt_from(tmp_path, families_of_paintings):
    pool_of_paintings.fill_pool(os.getppid(), tmp_path, 5, EVERY, [], ["washes"])
    assert families_of_paintings == [None, "washes", None, None]
    save_painting(tmp_path / "000000-dabs.npz", bars())  # made by a training that did not hold it out
    some = RecoveryData(tmp_path, ["coffee"], 5, 2, 3, 1, families=["washes"])
    some.batch(0)
    assert sorted(path.stem for path in some.loaded) == ["000001", "000002-washes"]
    assert some.held_out_numbers[:2] == [FIRST_HELD_OUT, FIRST_HELD_OUT + 2]
    assert len(some.held_out_numbers) == data.HELD_OUT_COUNT
    assert len(some.held_out_paintings(2)) == 2


def test_without_families_engines_make_every_painting(tmp_path, families_of_paintings):
    save_painting(tmp_path / "000000-dabs.npz", bars())
    pool_of_paintings.fill_pool(os.getppid(), tmp_path, 5, EVERY, [])
    assert families_of_paintings == [None] * len(EVERY)
    none = RecoveryData(tmp_path, ["coffee"], 5, 2, 3, 1)
    none.batch(0)
    assert sorted(path.stem for path in none.loaded) == ["000000", "000001", "000002"]
    assert none.held_out_numbers[1] == FIRST_HELD_OUT + 1


def maps_of(labels: np.ndarray) -> torch.Tensor:
    """Make the maps of a network that correctly predicts all affinities and all pixels with paint."""
    maps = torch.zeros(1, CHANNELS, *labels.shape)
    for channel, (dy, dx) in enumerate(AFFINITY_OFFSETS):
        there = np.roll(labels, (-dy, -dx), (0, 1))
        maps[0, channel] = torch.from_numpy(np.where(labels == there, SURE, -SURE))
    maps[0, PAINT] = torch.from_numpy(np.where(labels >= 0, SURE, -SURE))
    return maps


def crops_of(labels: np.ndarray) -> Crops:
    attributes = torch.zeros(1, len(StrokeAttribute), *labels.shape)
    return Crops(torch.zeros(1, 3, *labels.shape), torch.from_numpy(labels)[None], attributes)


@pytest.fixture
def three() -> np.ndarray:
    labels = np.full((64, 64), -1)
    labels[4:20, 4:60], labels[30:44, 4:30], labels[30:44, 30:60] = 0, 1, 2
    return labels


def test_a_network_that_knows_all_finds_all(three):
    counts = count_strokes(maps_of(three), crops_of(three))
    assert counts == Counts(3, 3, 3)
    assert counts.f1 == 1
    assert counts.plus(Counts(0, 1, 2)) == Counts(3, 4, 5)


def test_strokes_that_the_network_takes_for_one_are_lost(three):
    counts = count_strokes(maps_of(np.where(three == 2, 1, three)), crops_of(three))
    assert (counts.found, counts.known) == (2, 3)
    assert counts.f1 < 1
