"""Test that colour spaces composite paint in channels other than the picture's red, green and blue."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from brushexp_policies.topk import TopK
from kernels import BACKGROUND, DEGENERATE, DENSE, assert_agree, paint, paint_with_gradient
from PIL import Image
from refusals import refuses
from scenes import leaves, random_strokes, straight
from test_kernels import KINDS, TILED

from brushexp.painting.densification import importance
from brushexp.painting.picture import Picture
from brushexp.painting.reopen import space_of
from brushexp.plugins.blend.base import Compositor
from brushexp.plugins.blend.tiled import Tiled
from brushexp.plugins.renderer.analytic import Analytic
from brushexp.registry import build_named, plugins
from brushexp.strokes.catalogue import Strokes
from brushexp.strokes.storage import load_catalogue, save_catalogue
from brushexp.tasks import export
from brushexp.tasks import paint as painting

SPACES = {plugin.name: build_named("color", plugin.name, {}) for plugin in plugins("color")}
OTHERS = [name for name, space in SPACES.items() if not space.is_rgb]
CORNERS = torch.cartesian_prod(*3 * [torch.tensor([0.0, 0.02, 0.5, 1.0])])  # black, greys, white, pure colours
SIZE = (18, 27)
AUTO = Tiled(opaque=0.0)  # PyTorch draws layers that have no kernel for many channels


def decoded(space, channels):
    """Decode channels (n, C) to colours (n, 3)."""
    return space.decode(channels.T[:, :, None])[:, :, 0].T


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("name", SPACES)
def test_colours_come_back_and_black_and_white_are_0_and_1(name, dtype):
    space, colors = SPACES[name], torch.cat([CORNERS, torch.rand(500, 3)]).to(dtype).requires_grad_()
    channels = space.encode(colors)
    assert -1e-6 <= channels.min() <= channels.max() <= 1 + 1e-6
    torch.testing.assert_close(channels[[0, len(CORNERS) - 1]], torch.stack([0 * channels[0], 0 * channels[0] + 1]))
    back = decoded(space, channels)
    torch.testing.assert_close(back, colors, atol=1e-4, rtol=0)
    greys = space.encode(torch.linspace(0, 1, 9, dtype=dtype)[:, None].expand(-1, 3))
    mixed = decoded(space, torch.lerp(greys[:, None], greys, 0.3).flatten(0, 1))
    assert (mixed - mixed.mean(1, keepdim=True)).abs().max() < 1e-3, "mixtures of greys are grey"
    (slope,) = torch.autograd.grad(back[len(CORNERS) :].sum(), colors)
    torch.testing.assert_close(slope[len(CORNERS) :], torch.ones(500, 3, dtype=dtype), atol=2e-2, rtol=0)
    (slope,) = torch.autograd.grad((decoded(space, 0.5 * space.encode(colors)) + 0).sum(), colors)
    assert slope.isfinite().all()
    assert slope.abs().max() < 100


@pytest.mark.parametrize(("name", "taper"), [("rgb", 0.0), ("rgb", 0.6), *((name, 0.0) for name in OTHERS)])
def test_the_gradient_of_the_reference_is_right(name, taper):
    strokes = leaves(random_strokes(3, (4, 5), bend=0.1, dtype=torch.float64), torch.float64)
    blend = Compositor(DENSE, SPACES[name])

    def image(*values):
        return paint(Analytic(soft=1.5, taper=taper), blend, Strokes(*values), (4, 5)).image

    assert torch.autograd.gradcheck(image, tuple(value for _, value in strokes.items()), atol=1e-5)


@pytest.mark.parametrize(
    ("kind", "name"), [*((kind, "pigment") for kind in KINDS), ("plain", "oklab"), ("plain", "linear")]
)
def test_kernels_agree_with_the_reference_in_every_space(kind, name):
    space, strokes = SPACES[name], random_strokes(30, SIZE, bend=0.05)
    dense, order = Compositor(DENSE, space), torch.randperm(30)
    loose = {"slack": 5e-3, "exactness": 2e-3} if kind == "textured" else {"exactness": 5e-4, "slack": 2e-3}
    for blend in (AUTO, TopK(k=100)):
        assert_agree(KINDS[kind], Compositor(blend, space), strokes, SIZE, order=order, dense=dense, **loose)
    target = torch.rand(3, *SIZE)
    plain, mixed = (
        paint(KINDS[kind], b, strokes, SIZE, target=target).accuracy for b in (AUTO, Compositor(AUTO, space))
    )
    torch.testing.assert_close(mixed, plain, equal_nan=True)


@pytest.mark.parametrize("name", DEGENERATE)
def test_degenerate_strokes_in_pigment(name):
    blend, weight = Compositor(TILED, SPACES["pigment"]), torch.randn(3, 16, 19)
    image, gradient = paint_with_gradient(KINDS["plain"], blend, DEGENERATE[name], (16, 19), weight)
    assert 0 <= image.min() <= image.max() <= 1
    assert all(value.isfinite().all() for value in gradient.values())
    halves = DEGENERATE[name].map(lambda value: value.bfloat16())
    assert paint(Analytic(), blend, halves, (16, 19)).image.isfinite().all()


def test_a_yellow_glaze_over_blue_is_green_in_pigment_alone():
    blue = straight((-20, 8), (40, 8), width=40.0, color=(0.05, 0.15, 0.75), opacity=1.0)
    glaze = straight((-20, 8), (40, 8), width=40.0, color=(1.0, 0.9, 0.05), opacity=0.5)
    for name, space in SPACES.items():
        blend = Compositor(TILED, space)
        bare = paint(Analytic(), blend, blue, (16, 16)).image[:, 8, 8]
        torch.testing.assert_close(bare, blue.color[0], atol=1e-4, rtol=0)  # opaque paint has its own colour
        red, green, other = paint(Analytic(), blend, Strokes.join(glaze, blue), (16, 16)).image[:, 8, 8].tolist()
        assert (green > red + 0.05 and green > other + 0.05) == (name == "pigment")


@pytest.mark.parametrize("name", OTHERS)
def test_importance_is_estimated_in_the_picture(name):
    strokes, order, blend = random_strokes(25, SIZE, bend=0.05), torch.randperm(25), Compositor(DENSE, SPACES[name])
    image = blend(Analytic()(strokes), order, SIZE, BACKGROUND).image
    picture = Picture((image + 0.08 * torch.randn(3, *SIZE)).clamp(0, 1), None, BACKGROUND, blend)
    picture.renderer = Analytic()

    def error(chosen):
        image = blend(Analytic()(strokes), chosen, SIZE, BACKGROUND).image
        return (image - picture.target).square().double().sum()

    grown = torch.stack([error(order[order != i]) for i in range(25)]) - error(order)
    estimate = importance(strokes, order, picture, torch.Generator().manual_seed(0))
    ranks = torch.stack([estimate.argsort().argsort(), grown.argsort().argsort()]).double()
    assert torch.corrcoef(ranks)[0, 1] > 0.8


@pytest.mark.filterwarnings("ignore:.*in eval mode")
def test_catalogues_remember_the_space_and_exports_mix_in_it(run_task, tmp_path):
    run_task(painting, "image=coffee", "resolution=40", "steps=2", "color=pigment", "report=false", "frames=0")
    first = np.asarray(Image.open(tmp_path / "painting.png"))
    saved = load_catalogue(tmp_path / "catalogue.h5")
    assert type(space_of(saved)) is type(SPACES["pigment"])
    run_task(export, "task=export", f"catalogue={tmp_path / 'catalogue.h5'}")
    assert np.array_equal(np.asarray(Image.open(tmp_path / "painting.png")), first)
    for wrong in ("color: 7", "color: {_target_: brushexp.plugins.order.area.Area}"):
        refuses("color is", space_of, replace(saved, config=wrong))
    save_catalogue(tmp_path / "old.h5", replace(saved, config=""))
    assert space_of(load_catalogue(tmp_path / "old.h5")).is_rgb
