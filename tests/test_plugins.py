"""The contract of each family, checked for every registered plugin and preset, yours included."""

from functools import partial
from pathlib import Path

import pytest
import torch
from scenes import leaves, random_strokes

from brushexp.app.configs import SHIPPED
from brushexp.plugins.density.base import DensificationState
from brushexp.plugins.logger.base import Run
from brushexp.plugins.loss.base import PaintedView
from brushexp.plugins.order.base import front_to_back
from brushexp.registry import FAMILIES, MULTI_SELECT, build, plugins
from brushexp.strokes.catalogue import FIELDS, Catalogue, Strokes, check_strokes

ROOT = Path(__file__).parents[1]
SIZE = (24, 40)  # not square: catches a swap of height and width
TASK_OF = {"engine": "simulate", "to": "export"}  # families that the config of task=paint does not have


def names(family: str) -> list[str]:
    """Plugins and presets of a family."""
    presets = [path.stem for path in (SHIPPED / family).glob("*.yaml")]
    return sorted([plugin.name for plugin in plugins(family)] + presets)


def default(config, family: str, name: str):
    """Build a plugin from its default config."""
    cfg = config(f"{family}={name}")
    return build(cfg[family][name] if family in MULTI_SELECT else cfg[family])


@pytest.mark.parametrize("plugin", plugins(), ids=lambda plugin: f"{plugin.family}={plugin.name}")
def test_every_plugin_says_in_one_line_what_it_is(plugin):
    assert 10 <= len(plugin.summary) <= 200
    assert plugin.summary.rstrip(".:;") != plugin.cls.__name__


@pytest.mark.parametrize("family", FAMILIES)
def test_the_options_of_every_choice_are_typed(config, family):
    for name in names(family):
        node = config(f"task={TASK_OF.get(family, 'paint')}", f"{family}={name}")[family]
        assert "_target_" in (node[name] if family in MULTI_SELECT else node)


@pytest.mark.parametrize("n", [1, 7, 60])
@pytest.mark.parametrize("name", names("init"))
def test_init_makes_as_many_strokes_as_asked_in_range(config, name, n):
    make = default(config, "init", name)
    target = torch.rand(3, *SIZE)
    strokes = make(target, n, torch.Generator().manual_seed(1))
    assert len(strokes) == n
    assert all(value.dtype == torch.float32 for _, value in strokes.items())
    check_strokes(strokes)
    again = make(target, n, torch.Generator().manual_seed(1))
    assert all(torch.equal(getattr(strokes, field), getattr(again, field)) for field in FIELDS), "the seed decides"


@pytest.mark.parametrize("name", names("renderer"))
def test_renderer_is_bounded_and_differentiable_in_every_field(config, name):
    strokes = leaves(random_strokes(5, SIZE, width=(0.1, 0.3)))
    layers = default(config, "renderer", name)(strokes)
    points = torch.rand(1, 400, 2) * torch.tensor([40.0, 24.0])
    alpha, color = layers.sample(torch.arange(5)[None], points)
    assert alpha.shape == (1, 5, 400)
    assert color.shape in ((1, 5, 1, 3), (1, 5, 400, 3))
    assert alpha.min() >= -1e-6
    assert alpha.max() <= 1 + 1e-6
    (alpha[..., None] * color).sum().backward()
    assert {field for field, value in strokes.items() if value.grad.abs().sum() > 0} == set(FIELDS)
    fine = torch.linspace(0, 1, 200)  # nothing of a stroke lies beyond its reach
    weights = torch.stack([(1 - fine) ** 2, 2 * fine * (1 - fine), fine**2], -1)  # (200, 3)
    points = torch.rand(500, 2) * 80 - 20
    distance = torch.cdist(points[None], weights @ layers.curve.detach())  # (5, 500, 200)
    alpha, _ = layers.sample(torch.arange(5)[None], points[None])
    beyond = distance.min(-1).values > layers.reach[:, None] + 0.1
    assert (alpha[0][beyond] == 0).all()


@pytest.mark.parametrize("name", names("blend"))
def test_blend_paints_the_size_it_is_told(config, name):
    layers = default(config, "renderer", "analytic")(random_strokes(9, SIZE))
    canvas = default(config, "blend", name)(layers, torch.arange(9), SIZE, torch.ones(3), torch.rand(3, *SIZE))
    assert canvas.image.shape == (3, *SIZE)
    assert canvas.image.min() >= 0
    assert canvas.image.max() <= 1 + 1e-5
    assert canvas.accuracy.shape == (9,)


@pytest.mark.parametrize("name", names("order"))
def test_order_gives_every_stroke_a_depth(config, name):
    order = default(config, "order", name)
    assert order.every >= 1
    for accuracy in (None, torch.rand(9)):
        depth = order.depth(random_strokes(9, SIZE), accuracy)
        assert sorted(front_to_back(depth).tolist()) == list(range(9))


@pytest.mark.parametrize("name", names("loss"))
def test_loss_is_finite_differentiable_and_zero_at_best(config, name):
    loss = default(config, "loss", name)
    assert loss.weight > 0
    image, strokes = torch.rand(3, *SIZE, requires_grad=True), leaves(random_strokes(6, SIZE, bend=0.05))
    value = loss(PaintedView(image, torch.rand(3, *SIZE), strokes))
    assert value.shape == ()
    assert value.isfinite()
    assert value >= 0
    value.backward()
    assert all(grad is None or grad.isfinite().all() for grad in [image.grad, *(x.grad for _, x in strokes.items())])
    if image.grad is not None and image.grad.abs().sum() > 0:
        assert loss(PaintedView(image.detach(), image.detach(), strokes)) < 1e-8, "a perfect picture costs nothing"
    for n in (0, 1):
        assert loss(PaintedView(image, torch.rand(3, *SIZE), random_strokes(n, SIZE))).isfinite()


@pytest.mark.parametrize("name", names("density"))
@pytest.mark.parametrize("n", [0, 1, 40])
def test_density_revises_what_is_there(config, name, n):
    density, strokes = default(config, "density", name), random_strokes(n, SIZE)
    assert 1 <= density.first(60, 60) <= 60
    assert density.first(1, 60) == 1
    for step in range(1, 61):
        importance = partial(torch.rand, len(strokes))
        state = DensificationState(torch.rand(3, *SIZE), torch.rand(3, *SIZE), None, strokes, 60, step, 60, importance)
        update = density.revise(state)
        if update is not None:
            assert update.keep.shape == (len(strokes),)
            strokes = Strokes.join(strokes[update.keep], update.new)
            check_strokes(strokes)
        assert len(strokes) <= 60
    again = default(config, "density", name)
    again.load_state_dict(density.state_dict())
    assert again.state_dict() == density.state_dict()


@pytest.mark.parametrize("name", names("sampler"))
def test_sampler_stays_on_the_canvas(config, name):
    sampler = default(config, "sampler", name)
    for step in range(20):
        view = sampler(random_strokes(9, SIZE), SIZE, step, torch.Generator().manual_seed(step))
        region = view.region
        known = [number for number in (view.active, view.ring) if number is not None]
        assert len(torch.cat([torch.arange(0), *known]).unique()) == sum(map(len, known)) <= 9
        assert 0 <= region.top <= region.top + region.height <= SIZE[0]
        assert 0 <= region.left <= region.left + region.width <= SIZE[1]
        assert min(region.height, region.width) > 0


@pytest.mark.parametrize("name", names("optimizer"))
def test_optimizer_lowers_a_loss(config, name):
    optimizer = default(config, "optimizer", name)
    catalogue = Catalogue(random_strokes(6, SIZE), optimizer.units)
    goal = torch.full((6, 3), 0.5)
    torch_optimizer = optimizer.over(catalogue.parameters())

    def closure():
        torch_optimizer.zero_grad()
        loss = (catalogue().color - goal).square().mean()
        loss.backward()
        return loss

    before = float(closure().detach())
    rates = [group["lr"] for group in torch_optimizer.param_groups]
    for step in range(10):
        share = optimizer.share(step / 10)
        assert 0 <= share <= 1
        for group, rate in zip(torch_optimizer.param_groups, rates, strict=True):
            group["lr"] = share * rate
        torch_optimizer.step(closure)
    assert float(closure().detach()) < before


@pytest.mark.parametrize("name", names("logger"))
def test_logger_writes_into_the_folder_of_the_run(config, name, tmp_path, monkeypatch):
    monkeypatch.setenv("WANDB_MODE", "offline")
    logger = default(config, "logger", name)
    curves = logger.open(Run(tmp_path))
    curves.log_metrics({"loss/mse": 0.5}, step=1)
    curves.save()
    logger.finish(Run(tmp_path, status="completed", metrics={"psnr": 20.0}))
    curves.finalize("success")
    assert any(path.is_file() for path in tmp_path.rglob("*"))
