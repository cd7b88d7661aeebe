"""Test that patch renderers store their weights in files, load them again, and refuse invalid files."""

import json
import logging
import pickle
import re
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from brushexp_training.renderers import inverse_vgg
from brushexp_training.renderers.inverse_vgg import (
    NORMALISATIONS,
    InverseVGG,
)
from refusals import refuses
from safetensors.torch import load_file, save_file
from test_inverse_vgg import parameters, tiny

from brushexp.config.check import check
from brushexp.painting.stroke_optimizer import StrokeOptimizer
from brushexp.plugins.renderer import base
from brushexp.plugins.renderer.base import RENDERERS, PatchRenderer, window_pictures
from brushexp.registry import build_named
from brushexp.system.checkpoint import weights_hash
from brushexp.tasks import paint

OPTIONS = {"window": 64, "width": 4, "widest": 8, "dense": [16], "subpixel": 2, "tint": True, "noise": 0.0}
OPTIONS |= {"coordconv": "stroke", "activation": "relu", "normalisation": "none", "upsampling": "nearest"}


@pytest.fixture
def stored(tmp_path) -> Path:
    """Save a checkpoint of a tiny renderer."""
    path = tmp_path / "mine.safetensors"
    RENDERERS.save(path, "inverse_vgg", tiny(**OPTIONS), {"options": OPTIONS, "figures": {"l2": 1.0}})
    return path


@pytest.mark.parametrize("half", [False, True])
@pytest.mark.parametrize("normalisation", NORMALISATIONS)
def test_a_checkpoint_brings_the_same_pictures_and_hash_back(tmp_path, half, normalisation):
    options = {**OPTIONS, "normalisation": normalisation}
    renderer = tiny(**options).train()
    renderer.draw(parameters())  # fills the statistics of a batch norm
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
    refuses("is for renderer=dual, not for inverse_vgg", tiny, checkpoint=str(path))
    for other, typed in (({"dense": [16, 16]}, r"dense=\[16\]"), ({"tint": False}, "tint=true")):
        refuses(f"set renderer.{typed}", tiny, **{**OPTIONS, **other, "checkpoint": str(stored)})
    assert weights_hash(build_named("renderer", "analytic", {})) == "", "a formula has no weights"
    assert RENDERERS.restore(torch.nn.Linear(1, 1), "mine", None, {}) == ""


def test_a_plain_name_is_one_that_comes_with_the_program_which_ships_a_small_good_one(stored, monkeypatch):
    path = RENDERERS.path_of("inverse_vgg")
    assert path.stat().st_size < 2_000_000
    assert "/" not in path.with_suffix(".json").read_text(), "the recipe does not reveal its author's paths"
    shapes = parameters(40)
    with torch.no_grad():
        near, drawn = (
            window_pictures(build_named("renderer", name, {}), shapes, 64) for name in ("neural", "inverse_vgg")
        )
    assert -10 * (drawn - near)[:, 3].square().mean().log10() > 28, "the network itself is at 43 dB of true strokes"
    elsewhere = replace(RENDERERS, folders=lambda: [stored.parent])
    for module in (base, inverse_vgg):
        monkeypatch.setattr(module, "RENDERERS", elsewhere)
    assert weights_hash(tiny(**{**OPTIONS, "checkpoint": "mine"})) == RENDERERS.read_recipe(stored)["hash"]
    assert elsewhere.shipped_name("mine") == "mine"
    assert elsewhere.shipped_name("yours") is None
    refuses(r"yours is not a shipped checkpoint \(there are: mine\)", tiny, checkpoint="yours")


@pytest.mark.parametrize("fewer", [None, "seconds=5", "finish_steps=9"])
def test_steps_that_take_minutes_are_told_beforehand(run_task, monkeypatch, caplog, fewer):
    class BegunError(Exception):
        pass

    def begin(*_, **__):
        raise BegunError

    monkeypatch.setattr(PatchRenderer, "seconds_per_stroke", lambda self: 0.01)
    monkeypatch.setattr(StrokeOptimizer, "training_step", begin)
    words = ["image=moon", "renderer=inverse_vgg", "strokes=600", "resolution=64", *([] if fewer is None else [fewer])]
    with caplog.at_level(logging.INFO), pytest.raises(BegunError):
        run_task(paint, *words)
    told = "40 steps of 600 strokes with renderer=inverse_vgg take about 4 minutes; less: finish_steps=5"
    assert (told in caplog.text) == (fewer is None)
    assert ("minutes" in caplog.text) == (fewer is None)


@pytest.mark.parametrize(("words", "typed"), [
    (("renderer=neural_thesis",), "task=train renderer=neural_thesis output=outputs/neural_thesis, then add "
     "renderer.checkpoint=outputs/neural_thesis/inverse_vgg.safetensors"),
    (("renderer=inverse_vgg", "renderer.checkpoint=null"), "task=train renderer=inverse_vgg output="),
    (("renderer=neural", "renderer.checkpoint=null"), "task=train renderer=neural output="),
    (("warm_up=dual",), "renderer=dual has no trained weights"),
])  # fmt: skip
def test_nothing_is_painted_with_random_weights(config, words, typed):
    words = ("image=astronaut", "resolution=32", "strokes=9", *words)
    refuses(re.escape(typed), check, config(*words), words)


def change_recipe(path: Path, **changes: object) -> None:
    """Change entries of a recipe; None removes an entry."""
    recipe = json.loads(path.with_suffix(".json").read_text()) | changes
    recipe = {key: value for key, value in recipe.items() if value is not None}
    path.with_suffix(".json").write_text(json.dumps(recipe))


def change_bias(path: Path, bias: torch.Tensor | None) -> None:
    """Replace the bias of the last layer, or remove it if ``bias`` is None.

    The weights are copied before they are saved, because load_file maps the file itself.
    """
    weights = {name: value.clone() for name, value in load_file(path).items()} | {"last.bias": bias}
    save_file({name: value for name, value in weights.items() if value is not None}, path)


DAMAGE = {
    "missing": (Path.unlink, "there is no such file; give the .safetensors file of task=train"),
    "broken": (lambda p: p.write_bytes(p.read_bytes()[:1000]), "is damaged or cut short"),
    "other weights": (lambda p: change_bias(p, torch.ones(16)), "describes other weights; copy both files"),
    "no tensor": (lambda p: change_bias(p, None), "train it again with task=train: .*Missing.*last.bias"),
    "shape": (lambda p: change_bias(p, torch.zeros(3)), "another renderer; .*size mismatch for last.bias"),
    "nan": (lambda p: change_bias(p, torch.full((16,), torch.nan)), "last.bias has non-finite numbers"),
    "pickle": (lambda p: torch.save({"a": torch.ones(1)}, p), "cut short; pickle files are refused"),
    "old pickle": (lambda p: p.write_bytes(pickle.dumps({"weights": [1.0]})), "refused, because they can run code"),
    "no recipe": (lambda p: p.with_suffix(".json").unlink(), r"has no recipe beside it; also copy mine.json"),
    "no JSON": (lambda p: p.with_suffix(".json").write_text("{"), "is not JSON"),
    "other JSON": (lambda p: p.with_suffix(".json").write_text("[]"), "is not the recipe of a renderer"),
    "newer": (
        lambda p: change_recipe(p, format_version=99),
        "has format_version 99, and this brushexp reads 1; update brushexp",
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
