"""Renderers that draw windows: their contract, and their options."""

import json
import logging
import pickle
import re
import sys
from dataclasses import replace
from itertools import product
from pathlib import Path

import pytest
import torch
from brushexp_inverse_vgg import inverse_vgg, task
from brushexp_inverse_vgg.inverse_vgg import (
    ACTIVATIONS,
    COORDINATES,
    NORMALISATIONS,
    UPSAMPLING,
    InverseVGG,
    stroke_planes,
)
from brushexp_inverse_vgg.pruning import MULTIPLE, prune
from brushexp_training.datamodule import StrokeBatch
from brushexp_training.dataset import Origin
from brushexp_training.tasks import train
from brushexp_training.writer import simulate_set
from refusals import refuses
from safetensors.torch import load_file, save_file
from sweeps import read_csv
from torch.nn import functional

from brushexp.compositing.windows import Windows
from brushexp.config.check import check
from brushexp.plugins.renderer import base
from brushexp.plugins.renderer.analytic import Analytic
from brushexp.plugins.renderer.base import LEAST_ALPHA, PRECISIONS, RENDERERS, PatchRenderer, window_pictures
from brushexp.registry import build_named, plugins
from brushexp.strokes.prior import clamp_to_prior, parameters_of, sample_prior, strokes_of
from brushexp.system.callbacks import TimedCheckpoint
from brushexp.system.checkpoint import weights_hash
from brushexp.tasks import paint

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


def test_strokes_outside_the_range_are_drawn_at_its_edge_and_canvases_have_the_pictures_of_windows(renderer):
    far = 30 * parameters()
    far[0] = 0
    with torch.no_grad():
        images = window_pictures(renderer, far, renderer.window)
        nearest = window_pictures(renderer, parameters_of(clamp_to_prior(strokes_of(far))), renderer.window)
    assert bool(images.isfinite().all())
    torch.testing.assert_close(images, nearest)
    strokes = sample_prior(3)
    strokes = replace(strokes, position=strokes.position + 40, scale=torch.tensor([20.0, 64.0, 100.0]))
    with torch.no_grad():
        layers = renderer(strokes)
        assert isinstance(layers, Windows)
        drawn = renderer.draw(parameters_of(strokes))
    drawn[:, 3] *= drawn[:, 3] >= LEAST_ALPHA
    torch.testing.assert_close(layers.images, drawn)


def test_without_projection_strokes_outside_the_range_are_what_the_bare_network_draws():
    renderer, far = tiny(project=False).eval(), 1.5 * parameters()
    with torch.no_grad():
        bare = renderer.draw(far)
        images = window_pictures(renderer, far, renderer.window)
        assert not torch.equal(window_pictures(tiny().eval(), far, renderer.window), images)
    bare[:, 3] *= bare[:, 3] >= LEAST_ALPHA
    torch.testing.assert_close(images, bare)
    assert torch.equal(renderer.clamp(strokes_of(far)).start, strokes_of(far).start)


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


def test_noise_is_fresh_in_training_fixed_in_painting_and_of_the_size_of_the_signal_at_first():
    renderer = tiny(noise=1.0)
    with torch.no_grad():
        assert not torch.equal(renderer.train().draw(parameters()), renderer.draw(parameters()))
        assert torch.equal(renderer.eval().draw(parameters()), renderer.draw(parameters()))
        again = tiny(noise=1.0)
        again.load_state_dict(renderer.state_dict())
        assert torch.equal(again.draw(parameters()), renderer.draw(parameters()))
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


def test_networks_without_dense_layers_are_refused_and_measuring_their_time_changes_nothing():
    refuses(r"renderer\.dense=\[\]", tiny, dense=[])
    renderer = tiny(normalisation="batch").train()
    before = {name: value.clone() for name, value in renderer.state_dict().items()}
    assert 0 < renderer.seconds_per_stroke() < 60
    assert renderer.training
    assert all(value.grad is None for value in renderer.parameters())
    for name, value in renderer.state_dict().items():
        torch.testing.assert_close(value, before[name], atol=0, rtol=0)


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
    words = r"trained with renderer.shading=0.25, not 0.5; set renderer.shading=0.25"
    refuses(words, build_named, "renderer", "dual", {**options, "shading": 0.5, "checkpoint": str(path)})
    refuses("is of renderer=dual, not of inverse_vgg", tiny, checkpoint=str(path))
    for other, typed in (({"dense": [16, 16]}, r"dense=\[16\]"), ({"tint": False}, "tint=true")):
        refuses(f"set renderer.{typed}", tiny, **{**OPTIONS, **other, "checkpoint": str(stored)})
    assert weights_hash(build_named("renderer", "analytic", {})) == "", "it has no weights"
    assert RENDERERS.restore(torch.nn.Linear(1, 1), "mine", None, {}) == ""


def test_a_plain_name_is_one_that_comes_with_the_program_which_ships_a_small_good_one(stored, monkeypatch):
    path = RENDERERS.path_of("inverse_vgg")
    assert path.stat().st_size < 2_000_000
    assert "/" not in path.with_suffix(".json").read_text(), "it tells nothing of its maker"
    shapes = parameters(40)
    with torch.no_grad():
        near, drawn = (
            window_pictures(build_named("renderer", name, {}), shapes, 64) for name in ("neural", "inverse_vgg")
        )
    assert -10 * (drawn - near)[:, 3].square().mean().log10() > 28, "as is the network that is at 43 dB of true strokes"
    elsewhere = replace(RENDERERS, folders=lambda: [stored.parent])
    for module in (base, inverse_vgg):
        monkeypatch.setattr(module, "RENDERERS", elsewhere)
    assert weights_hash(tiny(**{**OPTIONS, "checkpoint": "mine"})) == RENDERERS.read_recipe(stored)["hash"]
    assert elsewhere.shipped_name("mine") == "mine"
    assert elsewhere.shipped_name("yours") is None
    refuses(r"yours does not come with the program \(there are: mine\)", tiny, checkpoint="yours")


@pytest.mark.parametrize("fewer", [None, "seconds=5", "finish_steps=9"])
def test_steps_that_take_minutes_are_told_beforehand(run_task, monkeypatch, caplog, fewer):
    class BegunError(Exception):
        pass

    def begin(*_, **__):
        raise BegunError

    monkeypatch.setattr(PatchRenderer, "seconds_per_stroke", lambda self: 0.01)
    monkeypatch.setattr(paint, "fit", begin)
    words = ["image=moon", "renderer=inverse_vgg", "strokes=600", "resolution=64", *([] if fewer is None else [fewer])]
    with caplog.at_level(logging.INFO), pytest.raises(BegunError):
        run_task(paint, *words)
    told = "40 steps of 600 strokes with renderer=inverse_vgg take some 4 minutes; less: finish_steps=5"
    assert (told in caplog.text) == (fewer is None)
    assert ("minutes" in caplog.text) == (fewer is None)


@pytest.mark.parametrize(("words", "typed"), [
    (("renderer=neural_thesis",), "task=train renderer=neural_thesis output=outputs/neural_thesis, then add "
     "renderer.checkpoint=outputs/neural_thesis/inverse_vgg.safetensors"),
    (("renderer=inverse_vgg", "renderer.checkpoint=null"), "task=train renderer=inverse_vgg output="),
    (("renderer=neural", "renderer.checkpoint=null"), "task=train renderer=neural output="),
    (("warm_up=dual",), "renderer=dual has no trained weights here"),
])  # fmt: skip
def test_nothing_is_painted_with_random_weights(config, words, typed):
    words = ("image=astronaut", "resolution=32", "strokes=9", *words)
    refuses(re.escape(typed), check, config(*words), words)


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
    refuses(message, tiny, **{**OPTIONS, "checkpoint": str(stored)})


PRUNED = {"window": 64, "width": 16, "widest": 32, "dense": [32, 16], "subpixel": 4, "activation": "relu"}
PRUNED |= {"coordconv": "stroke", "tint": True, "noise": 0.0, "normalisation": "none", "upsampling": "nearest"}


def smallest(**options) -> InverseVGG:
    return build_named("renderer", "inverse_vgg", {"checkpoint": None, **PRUNED, **options})


def batch(n: int = 6) -> StrokeBatch:
    parameters = parameters_of(sample_prior(n))
    with torch.no_grad():
        return StrokeBatch(parameters, window_pictures(Analytic(), parameters, 64), torch.arange(n))


@torch.no_grad()
def silence_every_other_channel(renderer: InverseVGG) -> None:
    """Let every second channel of every layer but the last be 0, whatever comes in."""
    for layer in renderer.dense:
        layer.weight[::2], layer.bias[::2] = 0, 0
    first = renderer.first
    first.weight.view(16, first.channels, -1)[:, ::2] = 0
    first.bias.view(16, first.channels)[:, ::2] = 0
    for layer in renderer.convolving:
        layer.convolution.weight[::2], layer.convolution.bias[::2] = 0, 0
        if layer.coordinates is not None:
            layer.coordinates.weight[::2] = 0
        if layer.strength is not None:
            layer.strength[::2] = 0


@pytest.mark.parametrize("options", [
    {},
    {"upsampling": "bilinear", "coordconv": "window"},
    {"coordconv": "none", "tint": False, "noise": 1.0},
    {"normalisation": "batch"},
])  # fmt: skip
def test_channels_that_do_nothing_are_the_ones_to_go(options):
    renderer = smallest(activation="elu", **options)  # after relu, others might be silent too
    silence_every_other_channel(renderer)
    before = renderer.state_dict()["last.weight"].clone()
    pruned = prune(renderer, 0.5, [batch()])
    assert pruned.widths == [width // 2 for width in renderer.widths]
    with torch.no_grad():
        inputs = parameters_of(sample_prior(5, seed=3))
        torch.testing.assert_close(pruned.draw(inputs), renderer.draw(inputs), rtol=1e-4, atol=1e-5)
    assert torch.equal(renderer.last.weight, before)


def test_widths_are_multiples_and_shrink_with_the_ratio():
    renderer = smallest()
    numbers = []
    for ratio in (0.0, 0.25, 0.5, 0.9):
        pruned = prune(renderer, ratio, [batch(2)])
        assert all(width % MULTIPLE == 0 and width >= MULTIPLE for width in pruned.widths)
        assert pruned.draw(batch(2).parameters).shape == (2, 4, 64, 64)
        numbers.append(sum(weight.numel() for weight in pruned.parameters()))
        assert ratio or weights_hash(pruned) == weights_hash(renderer)
    assert numbers == sorted(numbers, reverse=True)
    assert numbers[3] < 0.3 * numbers[0]
    again = prune(pruned, 0.5, [batch(2)])
    assert all(b <= a for a, b in zip(pruned.widths, again.widths, strict=True))
    assert all(weight.requires_grad and weight.grad is None for weight in again.parameters())
    again.draw(batch(2).parameters).square().mean().backward()
    assert all(bool(weight.grad.isfinite().all()) for weight in again.parameters())


def test_a_pruned_checkpoint_loads_by_its_name_alone(tmp_path):
    pruned = prune(smallest(), 0.5, [batch(2)]).eval()
    path = tmp_path / "pruned.safetensors"
    RENDERERS.save(path, "inverse_vgg", pruned, {"options": {**PRUNED, "channels": pruned.widths}})
    again = smallest(checkpoint=str(path))
    assert again.widths == pruned.widths != smallest().widths
    with torch.no_grad():
        assert torch.equal(again.draw(batch().parameters), pruned.draw(batch().parameters))
    assert weights_hash(smallest(checkpoint=str(path), channels=pruned.widths)) == weights_hash(pruned)
    words = r"was trained with renderer.channels=\[16, .*, not \[32, "
    refuses(words, smallest, checkpoint=str(path), channels=smallest().widths)


@pytest.mark.parametrize("channels", [[8], [8] * 30, [0] * 9, [8] * 8 + ["x"]])
def test_channels_of_a_file_that_do_not_fit_are_refused(channels, tmp_path):
    path = tmp_path / "pruned.safetensors"
    RENDERERS.save(path, "inverse_vgg", smallest(), {"options": {**PRUNED, "channels": channels}})
    refuses(r"renderer.channels=\[.*\] are not 9 widths", smallest, checkpoint=str(path))
    assert smallest(channels=[8] * 9).widths == [8] * 9


@pytest.mark.parametrize(("key", "value", "message"), [
    ("normalisation", "group", "group or instance mixes channels"),
    ("normalisation", "instance", "group or instance mixes channels"),
    ("upsampling", "pixel_shuffle", "pixel_shuffle ties channels to pixels"),
])  # fmt: skip
def test_networks_whose_channels_cannot_be_told_apart_are_refused(key, value, message, monkeypatch):
    refuses(f"renderer.{key}={message}", prune, smallest(**{key: value}), 0.5, [batch(2)])
    monkeypatch.setitem(sys.modules, "torch_pruning", None)
    refuses(r"task=prune needs torch-pruning; pip install 'brushexp\[prune\]'", prune, smallest(), 0.5, [])


@pytest.fixture
def run(tmp_path, run_task):
    """Run the task in this process, on strokes of the plainest engine."""
    strokes, trained = tmp_path / "strokes", tmp_path / "trained.safetensors"
    simulate_set(strokes, build_named("engine", "disc", {}), Origin("disc", {"window": 64}, 64), 0, 350)
    origin = {"engine": "disc", "engine_config": {"window": 64}, "window": 64}
    RENDERERS.save(trained, "inverse_vgg", smallest(), {"options": PRUNED, "data": origin})
    chosen = {"width": 16, "widest": 32, "dense": "[32,16]", "subpixel": 4, "checkpoint": trained}
    common = ["task=prune", "device=cpu", f"data={strokes}", "epochs=1", "limit=64", "n=8"]
    common += ["trainer.precision=32-true", *(f"renderer.{key}={value}" for key, value in chosen.items())]
    return lambda *overrides: run_task(task, *common, *overrides)


def test_strokes_in_windows_of_another_size_are_refused(run, tmp_path):
    simulate_set(
        tmp_path / "small", build_named("engine", "disc", {"window": 32}), Origin("disc", {"window": 32}, 32), 0, 33
    )
    words = r"renderer.window=64, but the strokes have 32 pixels"
    refuses(words, run, "ratios=[0.5]", f"data={tmp_path / 'small'}", "other_data=true")


def test_an_interrupted_run_recommends_nothing_that_there_is_not(run, tmp_path, monkeypatch):
    def stop(self, trainer, pl_module, *_):
        if pl_module.global_step == 1:
            self.pressed.set()

    monkeypatch.setattr(TimedCheckpoint, "on_train_batch_start", stop)
    with pytest.raises(KeyboardInterrupt) as caught:
        run("ratios=[0.5]", "batch_size=16")
    assert caught.value.args == (), "the whole run says what there is, not its part"
    assert not list(tmp_path.rglob("checkpoint.ckpt"))
    assert smallest(checkpoint=str(tmp_path / "inverse_vgg_50.safetensors")).widths != smallest().widths


def test_a_run_leaves_a_table_and_renderers_that_paint_and_train(run, run_task, tmp_path):
    metrics = run("ratios=[0,0.5]")
    assert (metrics["status"], metrics["n"]) == ("completed", 8)
    rows = json.loads((tmp_path / "metrics.json").read_text())["pruned"]
    assert [float(row["ratio"]) for row in read_csv(tmp_path / "pruning.csv")] == [0, 0.5]
    assert len((tmp_path / "pruning.md").read_text().splitlines()) == 4
    assert (tmp_path / "strokes.png").is_file()
    assert not list(tmp_path.rglob("checkpoint.ckpt"))
    assert rows[1]["parameters"] < 0.5 * rows[0]["parameters"]
    assert rows[1]["file_mb"] < rows[0]["file_mb"]
    assert rows[1]["l2"] < rows[1]["l2_before"]
    path = tmp_path / "inverse_vgg_50.safetensors"
    again = smallest(checkpoint=str(path))
    assert sum(weight.numel() for weight in again.parameters()) == rows[1]["parameters"]
    taught = ["task=train", "device=cpu", f"data={tmp_path / 'strokes'}", "epochs=1", "limit=64", "fid=0"]
    chosen = {"width": 16, "widest": 32, "dense": "[32,16]", "subpixel": 4, "checkpoint": path}
    words = (f"renderer.{key}={value}" for key, value in chosen.items())
    run_task(train, *taught, "renderer=inverse_vgg", *words)
    assert smallest(checkpoint=str(path.with_stem("inverse_vgg"))).widths == again.widths != smallest().widths
    recipe = json.loads(path.with_suffix(".json").read_text())
    assert recipe["training"]["pruned"] == 0.5
    assert Path(recipe["training"]["started_from"]).name == "trained.safetensors"
