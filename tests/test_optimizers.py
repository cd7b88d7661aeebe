"""Every optimiser paints, can be interrupted and goes on exactly, and lives with strokes that come and go."""

import io
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from scenes import random_strokes

from brushexp.errors import UserError
from brushexp.plugins.blend.tiled import Tiled
from brushexp.plugins.optimizer.base import Optimizer
from brushexp.plugins.optimizer.torch_optim import Library, RateSchedule, TorchOptim
from brushexp.plugins.renderer.analytic import Analytic
from brushexp.registry import build, build_named
from brushexp.strokes.catalogue import Catalogue

SIZE = (24, 33)
PRESETS = sorted(path.stem for path in (Path(__file__).parents[1] / "conf" / "optimizer").glob("*.yaml"))


def soap(**options) -> TorchOptim:
    return TorchOptim(**{"name": "SOAP", "library": Library.pytorch_optimizer} | options)


class Scene:
    """Strokes before a grey target, and an optimiser that moves them."""

    def __init__(self, optimizer: Optimizer, n: int = 20) -> None:
        self.share, self.lr = optimizer.share, optimizer.lr
        self.catalogue = Catalogue(random_strokes(n, SIZE), optimizer.units)
        self.optimizer = optimizer.over(p for p in self.catalogue.parameters() if p.requires_grad)
        self.target = torch.rand(3, 4, 6, generator=torch.Generator().manual_seed(1)).repeat_interleave(6, 1)
        self.target = self.target.repeat_interleave(6, 2)[:, : SIZE[0], : SIZE[1]]

    def loss(self) -> torch.Tensor:
        strokes = self.catalogue()
        canvas = Tiled()(Analytic()(strokes), torch.arange(len(strokes)), SIZE, torch.ones(3))
        return (canvas.image - self.target).square().sum() / (3 * 256 * 256)  # gradients as at 256 px, which sgd feels

    def take(self, steps: int, of: int = 20) -> None:
        def closure() -> torch.Tensor:
            self.optimizer.zero_grad(set_to_none=True)
            loss = self.loss()
            loss.backward()
            return loss.detach()

        for step in range(steps):
            for group in self.optimizer.param_groups:
                group["lr"] = self.lr * self.share(step / of)
            self.optimizer.step(closure)
            self.catalogue.keep_in_range()

    def error(self) -> float:
        return float(self.loss().detach())


@pytest.fixture
def preset(config) -> Callable[[str], Optimizer]:
    return lambda name: build(config(f"optimizer={name}").optimizer)


@pytest.mark.parametrize("name", PRESETS)
def test_a_preset_lowers_the_error_in_twenty_steps(preset, name):
    scene = Scene(preset(name))
    before = scene.error()
    scene.take(20)
    assert scene.error() < 0.8 * before


@pytest.mark.parametrize("n", [1, 2, 3])
@pytest.mark.parametrize("name", PRESETS)
def test_a_preset_moves_any_number_of_strokes(preset, name, n):
    scene = Scene(preset(name), n)
    before = [value.clone() for value in scene.catalogue.parameters()]
    scene.take(3)
    for old, new in zip(before, scene.catalogue.parameters(), strict=True):
        assert new.isfinite().all()
        assert not torch.equal(old, new)


@pytest.mark.parametrize("name", PRESETS)
def test_an_optimiser_goes_on_exactly_after_an_interruption(preset, name):
    whole = Scene(preset(name))
    whole.take(7)
    file = io.BytesIO()
    torch.save([whole.catalogue.state_dict(), whole.optimizer.state_dict()], file)
    file.seek(0)
    strokes, state = torch.load(file, weights_only=True)
    resumed = Scene(preset(name))
    resumed.catalogue.load_state_dict(strokes)
    resumed.optimizer.load_state_dict(state)
    for scene in (whole, resumed):
        scene.take(14)
    for key, value in whole.catalogue.state_dict().items():
        assert torch.equal(value, resumed.catalogue.state_dict()[key]), key


@pytest.mark.parametrize("name", PRESETS)
def test_strokes_may_come_and_go(preset, name):
    scene = Scene(preset(name))
    scene.take(5)
    scene.catalogue.revise(torch.arange(20) % 4 > 0, random_strokes(9, SIZE, seed=3), scene.optimizer)
    before = scene.error()
    scene.take(15)
    assert len(scene.catalogue) == 24
    assert scene.error() < before
    assert all(parameter in set(scene.catalogue.parameters()) for parameter in scene.optimizer.state)


def test_soap_keeps_no_matrix_as_long_as_the_strokes(preset):
    scene = Scene(preset("soap"), n=300)
    scene.take(3)
    sizes = [m.shape for state in scene.optimizer.state.values() for m in state["Q"] if len(m)]
    assert sorted(map(tuple, sizes)) == [(2, 2)] * 4 + [(3, 3)], "position, three points and colour"


def test_a_missing_library_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "pytorch_optimizer", None)
    with pytest.raises(UserError, match=r"needs the library pytorch-optimizer; pip install 'brushexp\[optimizers\]'"):
        soap()


@pytest.mark.parametrize("library", list(Library))
@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"name": "Nonsense"}, r"has no optimiser 'Nonsense'; set optimizer.name to one of .*Adam"),
        ({"lr": -1.0}, "optimizer.lr=-1 is not above 0; try optimizer.lr=0.02"),
        ({"hold": 1.5}, "optimizer.hold=1.5 is not 0 to 1; try optimizer.hold=1"),
        ({"warmup": -0.1}, "optimizer.warmup=-0.1 is not 0 to 1; try optimizer.warmup=0"),
    ],
)
def test_options_that_make_no_sense_are_refused(library, options, message):
    with pytest.raises(UserError, match=message):
        build_named("optimizer", "torch", {"library": library, **options})


@pytest.mark.parametrize("kind", [TorchOptim, soap])
@pytest.mark.parametrize("options", [{"nonsense": 1}, {"betas": [2.0, 0.9]}])
def test_options_that_the_library_does_not_take_are_refused(kind, options):
    with pytest.raises(UserError, match=r"optimizer\.options"):
        kind(options=options).over([torch.nn.Parameter(torch.zeros(3))])


@pytest.mark.parametrize(
    ("schedule", "shares"),
    [
        (RateSchedule.constant, [0.0, 1.0, 1.0, 1.0, 1.0]),
        (RateSchedule.linear, [0.0, 1.0, 1.0, 0.5, 0.0]),
        (RateSchedule.cosine, [0.0, 1.0, 1.0, 0.5, 0.0]),
    ],
)
def test_the_rate_rises_holds_and_falls(schedule, shares):
    optimizer, held = TorchOptim(schedule=schedule, hold=0.5, warmup=0.25), TorchOptim(schedule=schedule, hold=1.0)
    assert [optimizer.share(progress / 4) for progress in range(5)] == pytest.approx(shares, abs=1e-6)
    assert [held.share(progress / 4) for progress in range(5)] == [1] * 5, "it never falls"
