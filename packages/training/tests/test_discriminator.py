"""Test that corrupted strokes are invalid, that the discriminator learns, and that its files load."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch
from brushexp_training.discriminator import discriminator_module as task
from brushexp_training.discriminator.corruption import CORRUPTIONS, corrupt
from brushexp_training.discriminator.discriminator import (
    DISCRIMINATOR,
    DISCRIMINATORS,
    Discriminated,
    Discriminator,
    shapes_of,
)
from brushexp_training.discriminator.discriminator_module import (
    DiscriminatorModule,
    ShapeData,
    discriminator_figures,
    held_out_shapes,
    save_discriminator,
)
from brushexp_training.stroke_sets.dataset import Split
from hydra.errors import CompactHydraException
from refusals import refuses
from test_trainer import fit
from torch import Tensor

from brushexp.config.check import check
from brushexp.errors import UserError
from brushexp.plugins.loss.base import PaintedView
from brushexp.plugins.renderer.base import RENDERERS
from brushexp.registry import build_named
from brushexp.strokes.catalogue import Strokes
from brushexp.strokes.prior import INSET, SPREAD, THICKEST, THINNEST, bend_of, sample_prior, strokes_of

POINTS = ("start", "control", "end")


def generator(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def strokes(shapes: Tensor) -> Strokes:
    return strokes_of(torch.cat([shapes, torch.zeros(len(shapes), 3)], dim=1))


def loss_of(loss: Discriminated, made: Strokes) -> Tensor:
    nothing = torch.zeros(3, 5, 8)
    return loss(PaintedView(nothing, nothing, made))


def valid(made: Strokes, slack: float = 0.01) -> Tensor:
    """Return a mask (N,) of strokes that the prior could have sampled, with bends up to four standard deviations."""
    points = torch.stack([getattr(made, name) for name in POINTS], 1).abs().amax((1, 2))
    length = torch.linalg.vector_norm(made.end - made.start, dim=1)
    bend = (bend_of(made) / torch.tensor(SPREAD).sqrt()).norm(dim=1)
    fits = (points <= INSET + slack) & (length >= 4 * INSET * made.width - slack) & (bend <= 4)
    return fits & (made.width >= THINNEST - slack) & (made.width <= THICKEST + slack)


def wild(n: int, size: float) -> Strokes:
    made = sample_prior(n)
    start, control, end = size * torch.randn(3, n, 2, generator=generator(4))
    return replace(made, start=start, control=control, end=end, width=size * torch.rand(n, generator=generator(5)))


def test_valid_strokes_are_valid_corrupted_ones_are_not_and_every_step_gets_others():
    prior = shapes_of(sample_prior(2000))
    assert valid(strokes(prior)).float().mean() > 0.99
    shapes, _, kind = corrupt(prior, generator())
    for number, name in enumerate(CORRUPTIONS):
        share = float(valid(strokes(shapes[kind == number])).float().mean())
        assert share < (0.7 if name in ("mixed", "partly_noisy") else 0.25), f"{name}: {share}"
    batches = list(ShapeData(batch_size=4, seed=3).train_dataloader())
    assert len({batch.valid[0, 0].item() for batch in batches}) == len(batches) == 500
    loader = ShapeData(batch_size=4, seed=3).train_dataloader()
    loader.load_state_dict({"epoch": 0, "batch": 498})
    torch.testing.assert_close(next(iter(loader)), batches[498], rtol=0, atol=0)


def test_every_corruption_occurs_the_seed_decides_and_hard_negatives_are_half_way_in_some_groups():
    prior = shapes_of(sample_prior(500))
    (shapes, hard, kind), again, other = (corrupt(prior, generator(seed)) for seed in (1, 1, 2))
    assert set(kind.tolist()) == set(range(len(CORRUPTIONS)))
    assert all(torch.equal(a, b) for a, b in zip((shapes, hard, kind), again, strict=True))
    assert not torch.equal(shapes, other[0])
    assert shapes.isfinite().all()
    moved = hard != shapes
    torch.testing.assert_close(hard[moved], 0.5 * (prior + shapes)[moved])
    assert moved.any(1).float().mean() > 0.5


@pytest.fixture(scope="module")
def trained(tmp_path_factory) -> tuple[DiscriminatorModule, Path, dict[str, object]]:
    """Train a discriminator for a few seconds; return the module, its file and its figures."""
    torch.manual_seed(3)
    module = DiscriminatorModule(Discriminator(), 5e-3)
    fit(module, ShapeData(batch_size=64, seed=3), max_epochs=1)
    path = tmp_path_factory.mktemp("trained") / "mine.safetensors"
    return module, path, save_discriminator(module.network, path, 3, {"steps": module.global_step})


def test_it_learns_in_a_few_hundred_steps_and_valid_strokes_cost_almost_nothing(trained):
    module, _, figures = trained
    assert module.global_step == 500
    assert figures["auc"] > 0.85
    assert figures["accuracy"] > 0.75
    assert figures["hinge_corrupted"] > 50 * figures["hinge_valid"]
    assert set(figures) >= {f"auc_{name}" for name in CORRUPTIONS}
    assert float(module.trainer.callback_metrics["validation/auc"]) == pytest.approx(module.figures["auc"])
    assert "held out AUC" in module.state_line()
    loss, prior = Discriminated(), sample_prior(2000, seed=8)
    values = [float(loss_of(loss, prior))]
    for factor in (1.5, 3, 10, 100, 1000):
        large = {name: factor * getattr(prior, name) for name in POINTS}
        values.append(float(loss_of(loss, replace(prior, **large))))
    assert values[0] < 0.06
    assert values == sorted(values)
    assert values[1] > 20 * values[0]


def test_a_checkpoint_brings_the_same_loss_back_and_others_are_refused(trained, tmp_path):
    module, path, figures = trained
    loss = Discriminated(checkpoint=str(path))
    assert not any(parameter.requires_grad for parameter in loss.parameters())
    made = wild(20, 2.0)
    scores = module.network(shapes_of(made))
    expected = (module.network.threshold - scores).clamp_min(0).mean()
    torch.testing.assert_close(loss_of(loss, made), expected.detach())
    recipe = DISCRIMINATORS.read_recipe(path)
    assert recipe["hash"] == figures["discriminator_hash"]
    assert recipe["figures"]["auc"] == figures["auc"]
    assert recipe["training"]["steps"] == 500
    for checkpoint, message in (
        (RENDERERS.path_of("neural"), "not the recipe of a discriminator; give"),
        ("yours", r"yours is not a shipped checkpoint \(there are: discriminator\)"),
        (tmp_path / "none.safetensors", r"give the \.safetensors file of task=train_discriminator"),
    ):
        refuses(message, Discriminated, checkpoint=str(checkpoint))
    refuses("not the recipe of a renderer; give", build_named, "renderer", "neural", {"checkpoint": str(trained[1])})


def test_the_shipped_one_is_small_good_and_tells_nothing_of_its_maker():
    path = DISCRIMINATORS.path_of(DISCRIMINATOR)
    assert path.stat().st_size < 50_000
    text = path.with_suffix(".json").read_text()
    assert "/" not in text
    network = Discriminator()
    DISCRIMINATORS.restore(network, DISCRIMINATOR, DISCRIMINATOR, {})
    figures = discriminator_figures(network, held_out_shapes(11, Split.TEST))
    assert figures["auc"] > 0.95
    assert figures["accuracy"] > 0.9
    assert figures["hinge_valid"] < 0.06
    assert figures["hinge_corrupted"] > 50


def test_the_task_leaves_a_discriminator_with_defaults_and_numbers_of_its_own(config, run_task, tmp_path):
    cfg = config("task=train_discriminator", "lr=0.1", "~logger.csv", "trainer.profiler=simple")
    assert cfg == config("task=train_discriminator", "lr=0.1", "~logger.csv", "trainer.profiler=simple")
    assert (cfg.lr, cfg.minutes, config("task=train").minutes) == (0.1, None, 60)
    assert (cfg.trainer.precision, cfg.trainer.log_every_n_steps) == ("32-true", 20)
    for word in ("critic=true", "renderer=dual", "+engine.window=64", "data=a.h5"):
        with pytest.raises((CompactHydraException, UserError)):
            check(config("task=train_discriminator", word))
    metrics = run_task(task, "task=train_discriminator", "seed=7", "trainer.max_steps=50", "batch_size=16")
    assert (metrics["status"], metrics["steps"]) == ("completed", 50)
    path = tmp_path / "discriminator.safetensors"
    assert DISCRIMINATORS.read_recipe(path)["training"]["seed"] == 7
    assert DISCRIMINATORS.read_recipe(path)["figures"]["auc"] == metrics["auc"] > 0.5
    assert Discriminated(checkpoint=str(path)).weight > 0
