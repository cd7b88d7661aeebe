"""Paintings are made with their truth, and the network, its judges and their confidence learn from them."""

import os

import numpy as np
import pytest
import torch
from brushexp_recovery import finding, judges, judging, synthesis_pool
from brushexp_recovery.model import RecoveryModel
from brushexp_recovery.network import UNIT
from brushexp_recovery.synthesis import Hand, lay_strokes
from brushexp_recovery.synthesis_crops import turned
from brushexp_recovery.training import RecoveryModule
from test_recovery import bars, silent


def test_the_truth_of_a_painting_is_that_of_its_strokes():
    painted = bars()
    x, y, angle, wide, long, share = painted.geometry.T
    np.testing.assert_allclose([x, y], [[60, 60], [48, 48]], atol=0.5)
    np.testing.assert_allclose(np.exp(wide), 20, rtol=0.05)
    np.testing.assert_allclose(np.exp(long), 90, rtol=0.06)
    assert share[1] == 1
    assert share[0] == pytest.approx(1 - 20 * 20 / (70 * 20 + np.pi * 100), abs=0.02)
    assert np.cos(2 * (angle[0] - 0.4)) == pytest.approx(1, abs=1e-3)
    assert painted.labels[48, 60] == 1


@pytest.mark.parametrize("seed", range(6))
def test_turned_crops_point_to_the_centre_of_their_stroke(seed):
    painted = bars(0.7)
    labels = painted.labels[:, 12:108].astype(np.int64)
    labels[labels == 0] = -1  # the upper one is seen whole
    geometry = painted.geometry - np.array([12, 0, 0, 0, 0, 0], np.float32)
    image = np.zeros((96, 96, 3), np.float32)
    _, labels, maps = turned(image, labels, geometry, np.random.default_rng(seed))
    rows, columns = np.nonzero(labels == 1)
    at = maps[:, rows, columns]
    centre = np.stack([columns + 0.5, rows + 0.5]) + UNIT * at[:2]
    np.testing.assert_allclose(centre, np.repeat([[columns.mean() + 0.5], [rows.mean() + 0.5]], len(rows), 1), atol=1)
    xx, yy, xy = columns.var(), rows.var(), np.cov(columns, rows)[0, 1]
    shape = np.array([xx - yy, 2 * xy]) / np.hypot(xx - yy, 2 * xy)
    np.testing.assert_allclose(at[2:4].mean(1), shape, atol=0.02)


def test_strokes_are_laid_the_same_way_twice_and_cover_the_picture():
    picture = np.random.default_rng(0).random((64, 96, 3)).astype(np.float32)
    hand = Hand(hatch=0.5, palette=4, sway=0.3, taper=0.2)
    one, two = (lay_strokes(picture, 40, hand, np.random.default_rng(1)) for _ in range(2))
    np.testing.assert_array_equal(one.curve, two.curve)
    assert one.curve.shape == (40, 3, 2)
    assert (one.width > 0).all()
    assert ((one.color >= 0.01) & (one.color <= 0.99)).all()


def test_judges_learn_from_a_painting(monkeypatch):
    monkeypatch.setattr(judging, "STEPS", (20, 20, 20))
    monkeypatch.setattr(finding, "find_zoom", lambda *_: 0.7)  # what has learnt nothing sees strokes of any width
    model = RecoveryModel().eval()
    losses = judging.fit_judges(model, [bars()], 0, silent)
    assert all(np.isfinite(loss) for loss in losses.values())
    figures = judging.fit_beliefs(model, [bars(1.0)], 0)
    assert 0 <= figures["f1"] <= 1
    assert all(np.isfinite(value) for value in figures.values())


@pytest.mark.parametrize("biased", [True, False])
def test_a_linear_judge_finds_the_odds_that_made_its_examples(biased):
    random = np.random.default_rng(0)
    features, weight, bias = random.normal(size=(40_000, 3)) * [1, 10, 0.1], np.array([1.0, -0.05, 4.0]), 0.5 * biased
    chance = 1 / (1 + np.exp(-(features @ weight + bias)))
    linear = torch.nn.Linear(3, 1, bias=biased)
    judges.fit_linear(linear, features, random.random(len(chance)) < chance)
    told = 1 / (1 + np.exp(-judges.ask_linear(linear, features)))
    np.testing.assert_allclose(told, chance, atol=0.03)


def test_learning_lowers_the_loss():
    module = RecoveryModule(RecoveryModel().network, 1e-3)
    from brushexp_recovery.synthesis_crops import batch_of, crop  # noqa: PLC0415

    batch = batch_of([crop(bars(), np.random.default_rng(0), 64)])
    optimizer = torch.optim.Adam(module.network.parameters(), 1e-3)
    losses = []
    for _ in range(6):
        loss = module.training_step(batch, 0)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        losses.append(loss.item())
    assert losses[-1] < losses[0]


@pytest.mark.parametrize(("learnt", "progress", "keeps"), [(True, 0.0, True), (False, 0.1, False), (False, 0.9, True)])
def test_normalisations_keep_their_statistics_once_they_are_settled(learnt, progress, keeps, monkeypatch):
    monkeypatch.setattr(RecoveryModule, "progress", property(lambda _: progress))
    module = RecoveryModule(RecoveryModel().network, 1e-3, learnt)
    before = {name: value.clone() for name, value in module.network.named_buffers()}
    module.on_train_batch_start()
    module.network(torch.rand(2, 3, 64, 64))
    same = [torch.equal(value, before[name]) for name, value in module.network.named_buffers()]
    assert all(same) == keeps


def test_a_pool_is_filled_as_long_as_the_training_lives(tmp_path, monkeypatch):
    monkeypatch.setattr(synthesis_pool, "paint", lambda *_: bars())
    synthesis_pool.fill_pool(os.getppid(), tmp_path / "now", 0, range(2), [])
    assert len([*(tmp_path / "now").glob("*.npz")]) == 2
    synthesis_pool.fill_pool(os.getpid(), tmp_path / "later", 0, range(2), [])  # no parent of this process
    assert not [*(tmp_path / "later").glob("*.npz")]
