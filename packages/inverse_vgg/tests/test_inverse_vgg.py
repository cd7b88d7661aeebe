"""Renderers that draw windows: their contract, their options, and the files their weights are kept in."""

import json
import pickle
import re
from dataclasses import replace
from itertools import product
from pathlib import Path

import pytest
import torch
from brushexp_inverse_vgg import inverse_vgg
from brushexp_inverse_vgg.inverse_vgg import (
    ACTIVATIONS,
    COORDINATES,
    NORMALISATIONS,
    UPSAMPLING,
    InverseVGG,
    stroke_planes,
)
from safetensors.torch import load_file, save_file
from torch.nn import functional

from brushexp.compositing.windows import Windows
from brushexp.config.check import check
from brushexp.errors import UserError
from brushexp.plugins.renderer import base
from brushexp.plugins.renderer.base import LEAST_ALPHA, PRECISIONS, RENDERERS, PatchRenderer, window_pictures
from brushexp.registry import build_named, plugins
from brushexp.strokes.prior import clamp_to_prior, parameters_of, sample_prior, strokes_of
from brushexp.system.checkpoint import weights_hash

NAMES = [plugin.name for plugin in plugins("renderer") if issubclass(plugin.cls, PatchRenderer)]
TINY = {"width": 4, "widest": 8, "dense": [16], "checkpoint": None}


def tiny(**options) -> InverseVGG:
    return InverseVGG(**{**TINY, **options})


def parameters(n: int = 5) -> torch.Tensor:
    return parameters_of(sample_prior(n))


@pytest.fixture(params=NAMES)
def renderer(request) -> PatchRenderer:
    """Every patch renderer, as it is trained."""
    return build_named("renderer", request.param, {"checkpoint": None}).eval()


def test_it_draws_windows_in_range_with_a_finite_gradient_in_every_number(renderer):
    inputs = parameters().requires_grad_()
    images = renderer.draw(inputs)
    assert (images.shape, images.dtype) == ((5, 4, renderer.window, renderer.window), torch.float32)
    assert bool(((images >= 0) & (images <= 1)).all())
    (images[:, :3] * images[:, 3:]).sum().backward()
    assert bool(inputs.grad.isfinite().all())
    assert bool((inputs.grad.abs().sum(0) > 0).all())
    with torch.no_grad():
        assert torch.equal(renderer.draw(inputs), images), "it paints the same twice, and alone"
        torch.testing.assert_close(renderer.draw(inputs[2:3]), images[2:3], rtol=1e-4, atol=1e-5)


def test_strokes_outside_the_range_are_drawn_at_its_edge(renderer):
    far = 30 * parameters()
    far[0] = 0
    with torch.no_grad():
        images = window_pictures(renderer, far, renderer.window)
        nearest = window_pictures(renderer, parameters_of(clamp_to_prior(strokes_of(far))), renderer.window)
    assert bool(images.isfinite().all())
    torch.testing.assert_close(images, nearest)


def test_without_projection_strokes_outside_the_range_are_what_the_bare_network_draws():
    renderer, far = tiny(project=False).eval(), 1.5 * parameters()
    with torch.no_grad():
        bare = renderer.draw(far)
        images = window_pictures(renderer, far, renderer.window)
        assert not torch.equal(window_pictures(tiny().eval(), far, renderer.window), images)
    bare[:, 3] *= bare[:, 3] >= LEAST_ALPHA
    torch.testing.assert_close(images, bare)
    assert torch.equal(renderer.clamp(strokes_of(far)).start, strokes_of(far).start)


def test_the_pictures_of_a_canvas_are_those_of_the_windows(renderer):
    strokes = sample_prior(3)
    strokes = replace(strokes, position=strokes.position + 40, scale=torch.tensor([20.0, 64.0, 100.0]))
    with torch.no_grad():
        layers = renderer(strokes)
        assert isinstance(layers, Windows)
        drawn = renderer.draw(parameters_of(strokes))
    drawn[:, 3] *= drawn[:, 3] >= LEAST_ALPHA
    torch.testing.assert_close(layers.images, drawn)


COMBINED = [{"coordconv": c, "noise": n, "tint": t} for c, n, t in product(COORDINATES, (0.0, 1.0), (False, True))]
COMBINED += [{"activation": a, "normalisation": n} for a, n in product(ACTIVATIONS, NORMALISATIONS)]


@pytest.mark.parametrize("options", COMBINED, ids=str)
def test_the_layers_can_be_combined_and_trained(options):
    renderer = tiny(**options).train()
    pictures = renderer.draw(parameters())
    assert pictures.shape == (5, 4, 64, 64)
    pictures.mean().backward()
    assert all(bool(weight.grad.isfinite().all()) for weight in renderer.parameters())


@pytest.mark.parametrize("upsampling", UPSAMPLING)
@pytest.mark.parametrize(("window", "subpixel"), [(64, 1), (64, 4), (128, 2), (256, 4)])
def test_every_window_is_reached(upsampling, window, subpixel):
    renderer = tiny(upsampling=upsampling, window=window, subpixel=subpixel)
    with torch.no_grad():
        assert renderer.draw(parameters(2)).shape == (2, 4, window, window)


def test_the_planes_of_a_straight_stroke_are_its_coordinates():
    strokes = strokes_of(torch.tensor([[-0.5, -0.2, 0.0, 0.1, 0.5, 0.4, 0.0, 0.0, 0.0, 0.0]]))
    planes = stroke_planes(parameters_of(strokes), 64)[0]
    line = (torch.arange(64) + 0.5) / 32 - 1
    offset = torch.stack([line[None] + 0.5 + 0 * line[:, None], line[:, None] + 0.2 + 0 * line[None]])
    chord = (strokes.end - strokes.start)[0]
    length = chord.norm()
    along = (offset * chord[:, None, None]).sum(0) / length
    across = (chord[0] * offset[1] - chord[1] * offset[0]) / length / strokes.width
    torch.testing.assert_close(planes[0], 2 * (along / length).clamp(-0.5, 1.5) - 1)
    torch.testing.assert_close(planes[1], across.clamp(-3, 3))
    beyond = torch.maximum(-along, along - length).clamp_min(0) / strokes.width
    torch.testing.assert_close(planes[2], beyond.clamp_max(3.0))
    torch.testing.assert_close(planes[3], torch.exp(-(planes[1] ** 2) / 4) * torch.cos(torch.pi * planes[1]))


@pytest.mark.parametrize("zoom", [2, 4])
def test_folded_planes_are_planes_folded(zoom):
    folded = functional.pixel_unshuffle(stroke_planes(parameters(), 16), zoom)
    torch.testing.assert_close(stroke_planes(parameters(), 16, zoom), folded)


@pytest.mark.parametrize("first", [0, 2, 4], ids=["start", "control", "end"])
def test_places_on_a_degenerate_stroke_are_finite_with_their_gradient(first):
    inputs = 0.6 * torch.ones(2, 10)
    inputs[1] = 0
    inputs[0, first : first + 2] = -0.6  # two of the three points coincide; in the second stroke all of them do
    inputs.requires_grad_()
    planes = stroke_planes(inputs, 16)
    planes.square().sum().backward()
    assert bool(planes.isfinite().all())
    assert bool(inputs.grad.isfinite().all())


def test_noise_is_fresh_in_training_and_fixed_in_painting():
    renderer = tiny(noise=1.0)
    with torch.no_grad():
        assert not torch.equal(renderer.train().draw(parameters()), renderer.draw(parameters()))
        assert torch.equal(renderer.eval().draw(parameters()), renderer.draw(parameters()))
        again = tiny(noise=1.0)
        again.load_state_dict(renderer.state_dict())
        assert torch.equal(again.draw(parameters()), renderer.draw(parameters()))


def test_noise_is_of_the_size_of_the_signal_at_first():
    signals, noisy = [], []
    for strength, sizes in ((0.0, signals), (1.0, noisy)):
        torch.manual_seed(0)
        renderer = tiny(noise=strength, width=32, widest=96, dense=[256, 256]).train()
        for layer in renderer.convolving:
            layer.register_forward_hook(lambda layer, inputs, output, sizes=sizes: sizes.append(float(output.std())))
        with torch.no_grad():
            renderer.draw(parameters())
    added = (noisy[0] ** 2 - signals[0] ** 2) ** 0.5  # at the first layer, whose signal comes without noise
    assert 0.9 < added < 1.1
    assert all(1 / 3 < signal < 3 for signal in signals)


def test_a_network_without_dense_layers_is_refused():
    with pytest.raises(UserError, match=r"renderer\.dense=\[\]"):
        tiny(dense=[])


OPTIONS = {"window": 64, "width": 4, "widest": 8, "dense": [16], "subpixel": 2, "tint": True, "noise": 0.0}
OPTIONS |= {"coordconv": "stroke", "activation": "relu", "normalisation": "none", "upsampling": "nearest"}


@pytest.fixture
def stored(tmp_path) -> Path:
    """A checkpoint of a tiny renderer."""
    path = tmp_path / "mine.safetensors"
    RENDERERS.save(path, "inverse_vgg", tiny(**OPTIONS), {"options": OPTIONS, "figures": {"l2": 1.0}})
    return path


@pytest.mark.parametrize("half", [False, True])
@pytest.mark.parametrize("normalisation", NORMALISATIONS)
def test_a_checkpoint_brings_the_same_pictures_and_hash_back(tmp_path, half, normalisation):
    options = {**OPTIONS, "normalisation": normalisation}
    renderer = tiny(**options).train()
    renderer.draw(parameters())  # gives a batch norm something to keep
    path = tmp_path / "mine.safetensors"
    digest = RENDERERS.save(path, "inverse_vgg", renderer.eval(), {"options": options}, half=half)
    again = tiny(**options, checkpoint=str(path))
    with torch.no_grad():
        assert torch.equal(again.draw(parameters()), renderer.draw(parameters()))
    assert again.weights_hash == digest == weights_hash(renderer) == RENDERERS.read_recipe(path)["hash"]
    assert not again.training
    kinds = {value.dtype for value in load_file(path).values()} - {torch.int64}
    assert kinds == {torch.float16 if half else torch.float32}
    large = torch.nn.Linear(2, 1)
    torch.nn.init.constant_(large.weight, 1e6)
    RENDERERS.save(tmp_path / "large", "mine", large, {"options": {}}, half=half)
    assert load_file(tmp_path / "large.safetensors")["weight"].dtype == torch.float32, "too large for 16 bits"


def test_a_checkpoint_works_for_any_renderer_with_the_options_it_has(stored, tmp_path):
    options = {"window": 32, "width": 2, "shading": 0.25}
    renderer = build_named("renderer", "dual", options)
    path = tmp_path / "dual.safetensors"
    RENDERERS.save(path, "dual", renderer, {"options": {**options, "checkpoint": None}})
    again = build_named("renderer", "dual", {**options, "checkpoint": str(path)})
    assert weights_hash(again) == weights_hash(renderer) != ""
    with pytest.raises(UserError, match=r"trained with renderer.shading=0.25, not 0.5; set renderer.shading=0.25"):
        build_named("renderer", "dual", {**options, "shading": 0.5, "checkpoint": str(path)})
    with pytest.raises(UserError, match="is of renderer=dual, not of inverse_vgg"):
        tiny(checkpoint=str(path))
    for other, typed in (({"dense": [16, 16]}, r"dense=\[16\]"), ({"tint": False}, "tint=true")):
        with pytest.raises(UserError, match=f"set renderer.{typed}"):
            tiny(**{**OPTIONS, **other, "checkpoint": str(stored)})
    assert weights_hash(build_named("renderer", "analytic", {})) == "", "it has no weights"
    assert RENDERERS.restore(torch.nn.Linear(1, 1), "mine", None, {}) == ""


def test_a_plain_name_is_one_that_comes_with_the_program(stored, monkeypatch):
    elsewhere = replace(RENDERERS, folders=lambda: [stored.parent])
    for module in (base, inverse_vgg):
        monkeypatch.setattr(module, "RENDERERS", elsewhere)
    assert weights_hash(tiny(**{**OPTIONS, "checkpoint": "mine"})) == RENDERERS.read_recipe(stored)["hash"]
    assert elsewhere.shipped_name("mine") == "mine"
    assert elsewhere.shipped_name("yours") is None
    with pytest.raises(UserError, match=r"yours does not come with the program \(there are: mine\)"):
        tiny(checkpoint="yours")


def test_the_one_that_ships_is_small_and_draws_strokes_that_it_has_not_seen():
    path = RENDERERS.path_of("inverse_vgg")
    assert path.stat().st_size < 2_000_000
    assert "/" not in path.with_suffix(".json").read_text(), "it tells nothing of its maker"
    shapes = parameters(40)
    with torch.no_grad():
        near, drawn = (
            window_pictures(build_named("renderer", name, {}), shapes, 64) for name in ("neural", "inverse_vgg")
        )
    assert -10 * (drawn - near)[:, 3].square().mean().log10() > 28, "as is the network that is at 43 dB of true strokes"


@pytest.mark.parametrize(
    ("words", "typed"),
    [
        (("renderer=neural_thesis",), "task=train renderer=neural_thesis output=outputs/neural_thesis, then add "
         "renderer.checkpoint=outputs/neural_thesis/inverse_vgg.safetensors"),
        (("renderer=inverse_vgg", "renderer.checkpoint=null"), "task=train renderer=inverse_vgg output="),
        (("renderer=neural", "renderer.checkpoint=null"), "task=train renderer=neural output="),
        (("warm_up=dual",), "renderer=dual has no trained weights here"),
    ],
)  # fmt: skip
def test_nothing_is_painted_with_random_weights(config, words, typed):
    words = ("image=astronaut", "resolution=32", "strokes=9", *words)
    with pytest.raises(UserError, match=re.escape(typed)):
        check(config(*words), words)


def change_recipe(path: Path, **changes: object) -> None:
    """Change the recipe; None takes something out."""
    recipe = json.loads(path.with_suffix(".json").read_text()) | changes
    recipe = {key: value for key, value in recipe.items() if value is not None}
    path.with_suffix(".json").write_text(json.dumps(recipe))


def change_bias(path: Path, bias: torch.Tensor | None) -> None:
    """Change the bias of the last layer; None takes it out. What load_file gives lies in the file, so copies go out."""
    weights = {name: value.clone() for name, value in load_file(path).items()} | {"last.bias": bias}
    save_file({name: value for name, value in weights.items() if value is not None}, path)


DAMAGE = {
    "missing": (Path.unlink, "there is no such file; give the .safetensors of task=train"),
    "broken": (lambda p: p.write_bytes(p.read_bytes()[:1000]), "is damaged or cut short"),
    "other weights": (lambda p: change_bias(p, torch.ones(16)), "describes other weights; copy both files"),
    "no tensor": (lambda p: change_bias(p, None), "train it again with task=train: .*Missing.*last.bias"),
    "shape": (lambda p: change_bias(p, torch.zeros(3)), "another renderer; .*size mismatch for last.bias"),
    "nan": (lambda p: change_bias(p, torch.full((16,), torch.nan)), "last.bias has numbers that are not finite"),
    "pickle": (lambda p: torch.save({"a": torch.ones(1)}, p), "cut short .*; pickles are refused"),
    "old pickle": (lambda p: p.write_bytes(pickle.dumps({"weights": [1.0]})), "refused, because they can run code"),
    "no recipe": (lambda p: p.with_suffix(".json").unlink(), r"has no recipe beside it; copy mine.json"),
    "no JSON": (lambda p: p.with_suffix(".json").write_text("{"), "is not JSON"),
    "other JSON": (lambda p: p.with_suffix(".json").write_text("[]"), "is not the recipe of a renderer"),
    "newer": (
        lambda p: change_recipe(p, format_version=99),
        "has format_version 99, and this brushexp reads 1; update it",
    ),
    "half": (lambda p: change_recipe(p, options=None), "has no options"),
}


@pytest.mark.parametrize(("damage", "message"), DAMAGE.values(), ids=DAMAGE.keys())
def test_a_bad_checkpoint_is_refused_in_one_clear_line(stored, damage, message):
    damage(stored)
    with pytest.raises(UserError, match=message) as caught:
        tiny(**{**OPTIONS, "checkpoint": str(stored)})
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", NAMES)
def test_sixteen_bits_draw_and_pull_as_thirty_two_do(name):
    strokes, drawn, pulls = sample_prior(6), [], []
    for precision in ("float32", "bfloat16"):
        torch.manual_seed(1)
        options = {"checkpoint": None, "precision": precision}
        renderer = build_named("renderer", name, options).requires_grad_(False).eval()
        leaves = strokes.map(lambda value: value.clone().requires_grad_())
        images = renderer(leaves).images
        assert images.dtype == torch.float32
        assert {weight.dtype for weight in renderer.parameters()} == {torch.float32}
        (images * torch.linspace(-1, 1, images[0].numel()).reshape(images[0].shape)).sum().backward()
        assert leaves.width.grad.dtype == torch.float32
        drawn.append(images.detach()[:, 3:] * images.detach())
        pulls.append(torch.cat([getattr(leaves, key).grad.flatten() for key in ("start", "control", "end", "width")]))
    assert not torch.equal(*drawn)
    torch.testing.assert_close(*drawn, atol=0.02, rtol=0)
    assert (drawn[0] - drawn[1]).square().mean().sqrt() < 2e-3
    assert torch.nn.functional.cosine_similarity(*pulls, dim=0) > 0.99
    same = [tiny(precision=precision) for precision in PRECISIONS]
    same[1].load_state_dict(same[0].state_dict())
    assert torch.equal(*(renderer.train()(strokes).images for renderer in same)), "training has its own precision"
