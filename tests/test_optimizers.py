"""Tests that every optimiser paints, resumes exactly, and handles added and removed strokes."""

import sys

import pytest
import torch
from painters import assert_resumes, error_of, painter_of, take
from refusals import refuses
from scenes import random_strokes
from torch import Tensor
from torch.testing import assert_close
from typed import nodes

from brushexp.errors import UserError
from brushexp.painting.stroke_optimizer import StrokeOptimizer
from brushexp.plugins.density.base import DensificationUpdate, Density
from brushexp.plugins.optimizer.base import Optimizer
from brushexp.plugins.optimizer.torch import LIBRARIES, TorchOptim
from brushexp.plugins.renderer.analytic import Analytic
from brushexp.registry import build, build_named
from brushexp.strokes.catalogue import Catalogue, Strokes
from brushexp.system.words import SHIPPED

SIZE = (24, 33)
PRESETS = sorted(path.stem for path in (SHIPPED / "optimizer").glob("*.yaml"))
every_preset = pytest.mark.parametrize("name", PRESETS)


def soap(**options) -> TorchOptim:
    return TorchOptim(**{"name": "SOAP", "library": "pytorch_optimizer"} | options)


def scene(optimizer: Optimizer, n: int = 20, **parts) -> StrokeOptimizer:
    """Return a painter with 20 steps and a target of coloured blocks."""
    target = torch.rand(3, 4, 6, generator=torch.Generator().manual_seed(1))
    target = target.repeat_interleave(6, 1).repeat_interleave(6, 2)[:, : SIZE[0], : SIZE[1]]
    weight = SIZE[0] * SIZE[1] / 256**2  # gives sgd the gradients that it has at 256 px
    losses = {"mse": build_named("loss", "mse", {"weight": weight})}
    parts = {"strokes": random_strokes(n, SIZE), "target": target, "losses": losses} | parts
    return painter_of(steps=20, optimizer=optimizer, **parts)


def preset(name: str) -> Optimizer:
    return build(nodes()["optimizer", name])


@every_preset
def test_a_preset_lowers_the_error_in_twenty_steps_and_lets_each_stage_start_afresh(name):
    painter = scene(preset(name))
    before = error_of(painter)
    take(painter, 20)
    assert error_of(painter) < 0.9 * before
    painter = scene(preset(name))
    optimizer = take(painter, 3)["optimizer"]
    painter._restart(optimizer)
    assert not optimizer.state
    assert all(group.get("step", 0) == 0 for group in optimizer.param_groups)


class HoldsOdd(Analytic):
    """Holds every second stroke."""

    def held(self, strokes: Strokes) -> Tensor:
        return (strokes.brush % 2).nonzero()[:, 0]


@pytest.mark.parametrize("sampler", ["whole", "patches"])
@pytest.mark.parametrize("optimizer", ["Adam", "AdamW", "LBFGS"])
def test_steps_leave_strokes_that_the_renderer_holds_whatever_the_losses(optimizer, sampler):
    losses = {name: build_named("loss", name, {}) for name in ("mse", "width", "kl")}
    parts = {"renderer": HoldsOdd(), "losses": losses, "sampler": build_named("sampler", sampler, {})}
    painter = scene(TorchOptim(name=optimizer), **parts)
    before = painter.strokes()
    take(painter, 20)
    after = painter.strokes()
    for name, value in before.items():
        assert_close(getattr(after, name)[1::2], value[1::2], rtol=0, atol=1e-5, msg=name)
    assert bool((after.color - before.color)[::2].abs().amax(1).gt(1e-3).any())
    assert bool((after.width - before.width)[::2].abs().gt(1e-3).any())


@pytest.mark.parametrize("n", [1, 2, 3])
@every_preset
def test_a_preset_moves_any_number_of_strokes(name, n):
    painter = scene(preset(name), n)
    before = [value.clone() for value in painter.catalogue.parameters()]
    take(painter, 3)
    for old, new in zip(before, painter.catalogue.parameters(), strict=True):
        assert new.isfinite().all()
        assert not torch.equal(old, new)


@every_preset
def test_an_optimiser_goes_on_exactly_after_an_interruption_and_strokes_may_come_and_go(name, tmp_path):
    class Swap(Density):
        def due(self, step, steps):
            return step == 5

        def revise(self, state):
            return DensificationUpdate(torch.arange(20) % 4 > 0, random_strokes(9, SIZE, seed=3))

    painter = scene(preset(name), density=Swap())
    loop = take(painter, 5)
    before = error_of(painter)
    take(painter, 15, loop)
    assert len(painter.catalogue) == 24
    assert error_of(painter) < before
    assert set(loop["optimizer"].state) <= set(painter.catalogue.parameters())
    assert_resumes(lambda: scene(preset(name)), 7, tmp_path)


def test_soap_keeps_no_matrix_as_long_as_the_strokes_and_names_its_library_if_that_is_missing(monkeypatch):
    optimizer = take(scene(preset("soap"), n=300), 3)["optimizer"]
    sizes = [m.shape for state in optimizer.state.values() for m in state["Q"] if len(m)]
    assert sorted(map(tuple, sizes)) == [(2, 2)] * 4 + [(3, 3)], "position, three points and colour"
    monkeypatch.setitem(sys.modules, "pytorch_optimizer", None)
    refuses(r"needs the library pytorch-optimizer; pip install 'brushexp\[optimizers\]'", soap)


@pytest.mark.parametrize("library", LIBRARIES)
def test_an_unknown_optimiser_is_refused(library):
    with pytest.raises(UserError, match=r"has no optimiser 'Nonsense'; choose optimizer.name from .*Adam"):
        build_named("optimizer", "torch", {"library": library, "name": "Nonsense"})


@pytest.mark.parametrize("kind", [TorchOptim, soap])
@pytest.mark.parametrize("options", [{"nonsense": 1}, {"betas": [2.0, 0.9]}])
def test_options_that_the_library_does_not_take_are_refused(kind, options):
    with pytest.raises(UserError, match=r"optimizer\.options"):
        kind(options=options).over([torch.nn.Parameter(torch.zeros(3))])


@pytest.mark.parametrize(("schedule", "end"), [("constant", [1.0, 1.0]), ("linear", [0.5, 0]), ("cosine", [0.5, 0])])
def test_the_rate_rises_holds_and_falls(schedule, end):
    optimizer, held = TorchOptim(schedule=schedule, hold=0.5, warmup=0.25), TorchOptim(schedule=schedule, hold=1.0)
    assert [optimizer.share(progress / 4) for progress in range(5)] == pytest.approx([0, 1, 1, *end], abs=1e-6)
    assert [held.share(progress / 4) for progress in range(5)] == [1] * 5, "it never falls"


@pytest.mark.parametrize("missing", [False, True])
@every_preset
def test_steps_without_a_slope_move_nothing(name, missing):
    """Parameters stay put, but AdamW's weight decay shrinks them by the preset's rate per step if gradients are 0."""
    chosen, steps = preset(name), 200
    catalogue = Catalogue(random_strokes(9, SIZE), chosen.units)
    optimizer = chosen.over(catalogue.parameters())
    before = [parameter.detach().clone() for parameter in catalogue.parameters()]

    def closure() -> Tensor:
        optimizer.zero_grad(set_to_none=True)
        if not missing:
            for parameter in catalogue.parameters():
                parameter.grad = torch.zeros_like(parameter)
        return torch.zeros(())

    for _ in range(steps):
        optimizer.step(closure)
    decay = 0.0 if missing else optimizer.param_groups[0].get("weight_decay", 0.0)
    left = (1 - optimizer.param_groups[0]["lr"] * decay) ** steps
    assert (left < 1) == (name == "adamw" and not missing)
    for old, new in zip(before, catalogue.parameters(), strict=True):
        assert new.isfinite().all()
        assert torch.equal(old, new.detach()) if left == 1 else (old * left - new).abs().max() < 1e-3 * old.abs().max()
    values = [value for state in optimizer.state.values() for value in state.values() if torch.is_tensor(value)]
    assert all(value.isfinite().all() for value in values)
