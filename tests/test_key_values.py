"""Tests that every task key and plugin option accepts valid values and refuses others in one line."""

import os
import re
import tempfile
from dataclasses import fields
from functools import cache
from inspect import signature
from pathlib import Path

import numpy as np
import pytest
from brushexp_training.renderers.inverse_vgg import InverseVGG
from catalogues import catalogue
from films import encoded, scene
from hydra.errors import CompactHydraException
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException
from PIL import Image
from refusals import refuses
from typed import TASK_OF, configured, nodes, typed_into

from brushexp.cli.many_pictures import expand_pictures, name_of
from brushexp.cli.program import expand_arguments
from brushexp.config import compose
from brushexp.config.check import check
from brushexp.config.compose import CHOSEN_GROUPS
from brushexp.config.keys import keys_of
from brushexp.config.mistakes import explain_grammar_error, translate
from brushexp.config.tasks import TASKS
from brushexp.config.vocabulary import with_words_of_changes
from brushexp.config.words import expand_positional, parse_value
from brushexp.errors import UserError
from brushexp.plugins.renderer.base import RENDERERS
from brushexp.registry import MULTI_SELECT, literal, options_in, plugins
from brushexp.strokes.storage import save_catalogue
from brushexp.system.words import conf_folders

FILES = Path(tempfile.mkdtemp())
save_catalogue(FILES / "a.h5", catalogue(60))
(FILES / "a.npz").touch()
Image.new("L", (50, 30), 255).save(FILES / "a.png")
Image.fromarray((255 * np.eye(30, 50)).astype(np.uint8)).save(FILES / "lines.png")
DEFAULTS = {name: one.default for name, one in signature(InverseVGG).parameters.items() if name != "checkpoint"}
RENDERERS.save(FILES / "a.safetensors", "inverse_vgg", InverseVGG(), {"options": DEFAULTS})
NEEDED = {task: f"catalogue={FILES}/a.h5" for task in ("export", "analyse", "view")} | dict.fromkeys(
    ("compare", "departures", "verdicts"), f"runs={FILES}"
)
NEEDED["film"] = f"image={encoded(FILES / 'a.mp4', scene(2))}"
NEEDED["recover"] = NEEDED["sample"] = "image=coffee"
NEEDED["canvas"] = f"image={FILES}/a.mp4 canvas={FILES}/a.zarr"  # the check only looks for it
NEEDED["score"] = f"strokes={FILES}/a.h5 truth={FILES}/a.npz"
NEEDED["prune"] = f"renderer.checkpoint={FILES}/a.safetensors"
NEVER = ["nan", "-inf", "1e39", "9" * 23, "text", "''", "[1]", "[nan]", "[[mse]]", "{a: 1}", "true"]  # invalid numbers
VALUES = [*NEVER, "-1", "0", "0.5", "null"]
NUMBERS = (int, float, int | None, float | None)


def refusal(cfg, task, words):
    """Return the error message for these words, or "" if they are valid."""
    try:
        with typed_into(cfg, expand_arguments(words)):
            check(cfg, words)
    except UserError as error:
        return str(error)
    except (CompactHydraException, OmegaConfBaseException) as error:
        cause = f": {error.__cause__}" if error.__cause__ else ""
        return translate(" ".join(f"{error}{cause}".split()), task, conf_folders()) or f"in words of Hydra: {error}\n"
    return ""


@cache
def config_of(task, family="", name=""):
    """Compose a task's config in which a family contains only the named plugin."""
    cfg = configured(expand_arguments([f"task={task}", *NEEDED.get(task, "").split()]))
    if family:
        node = nodes()[family, name].copy()
        if name == "brushwork":
            node.catalogue = f"{FILES}/a.h5"
        cfg[family] = {name: node} if family in MULTI_SELECT else node
    return cfg


def declared():
    """List the config, name and type of every key and option, without duplicates."""
    options = {}
    for task, schema in TASKS.items():
        for name, key in keys_of(schema).items():
            options.setdefault((name, key.annotation, key.bounds), ((task,), name, key.annotation))
    for plugin in plugins():
        for item in fields(plugin.config)[1:]:
            key = plugin.family, item.name, plugin.bounds[item.name]
            which = TASK_OF.get(plugin.family, "paint"), plugin.family, plugin.name
            options.setdefault(key, (which, f"{plugin.path}.{item.name}", item.type))
    return options.values()


@pytest.mark.slow(kernels=False)
def test_every_value_fits_or_is_refused_in_one_line_that_names_the_key():
    """Each key accepts or refuses a twelfth of the values, in rotation, or all values if ``BRUSHEXP_VALUES=all``."""
    without, wrong = {}, []
    apart = 1 if os.environ.get("BRUSHEXP_VALUES") == "all" else 12
    for k, (which, name, kind) in enumerate(declared()):
        (task, *_), cfg = which, config_of(*which)
        if which not in without:
            without[which] = refusal(cfg, task, [f"task={task}"])
        for value in VALUES[k % apart :: apart]:
            text = refusal(cfg, task, [f"task={task}", f"{name}={value}"])
            told = text and text != without[which]  # a network may lack weights, whatever the value
            named = name in text or with_words_of_changes(name) in text
            if (told and (not named or "\n" in text)) or (not text and value in NEVER and kind in NUMBERS):
                wrong.append(f"{name}={value}: {text}")
    assert not wrong


@pytest.mark.parametrize("value", ["null", "[1]", "[[mse]]", "7", "nan", "true", "''", "mse,null"])
@pytest.mark.parametrize("group", sorted(CHOSEN_GROUPS))
def test_what_can_be_no_name_is_refused_before_hydra_sees_it(group, value):
    refuses(f"{group}=.* is not a name; choose one of", expand_arguments, ["-m", f"{group}={value}"])


@pytest.mark.parametrize(("words", "cure"), [
    ("finer bolder", "finer and bolder both set detail; keep one, or try both: -m detail=2,0.25"),
    ("oil moon watercolor", "oil and watercolor both set look; keep one, or try both: -m look=oil,watercolour"),
    ("moon look=ink oil", "look=ink and oil both set look; keep one, or try both: -m look=ink,oil"),
    ("detail=1 finer", "detail=1 and finer both set detail; keep one, or try both: -m detail=1,2"),
    ("coffee look=ink look=oil", "look is given twice: ink and oil; keep one, or try both: -m look=ink,oil"),
    ("loss=mse loss=l1", "loss is given twice: mse and l1; keep one, or type both: 'loss=[mse,l1]'"),
])  # fmt: skip
def test_two_words_of_a_kind_are_no_order(words, cure):
    refuses(re.escape(cure), expand_arguments, words.split())
    assert expand_arguments(["oil", "finer", "fine", "look=oil"])[:2] == ["look=oil", "detail=2"]


@pytest.mark.parametrize("words", [
    "strokes=10 strokes=20",
    "look=watercolor look=watercolour",
    "ink look=ink",
    "-m look=ink,oil look=ink,oil",
    "image=coffee image=moon",
    "pictures=p pictures=q",
    "view coffee.h5",
    "+change=[wet] wet=0.5",
])  # fmt: skip
def test_equal_repeats_and_keys_that_take_several_words_are_no_mistake(words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert expand_arguments(words.split())


@pytest.mark.parametrize("task", TASKS)
def test_every_task_begins_with_what_it_needs_and_no_more(task):
    check(config_of(task))


@pytest.mark.parametrize("key", ["image", "style", "focus", "output", "resume", "catalogue", "renderer.checkpoint"])
def test_files_have_any_name(key, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = ["photo (1).png", "photo(1).png", "a[1].png", "a=b.png", "a{1}.png", "a, b.png", "it's.png", 'say "hi".png']
    names += ["a#b.png", "50%.png", "cost$.png", "a${b}.png", "ü 漢.png", "2024", "007", "1e3", "true", "inf", "a\\b"]
    names += ["a\\", "x${", "a\\${b}", "\\\\${b}"]
    for name in names:
        (tmp_path / name).write_text("")
        if key in ("output", "resume") and "${" in name:  # a resumed run writes into its folder
            refuses("cannot write into .*, because its name contains", expand_arguments, [f"{key}={name}"])
            continue
        word = expand_arguments([f"{key}={name}"])[0]
        assert OmegaConf.create({"is": parse_value(word.partition("=")[2])})["is"] == name, word
    swept = expand_arguments(["-m", f"{key}=photo (1).png,2024"])[1]
    whole = "a sweep has one folder"
    assert swept.endswith('="photo (1).png,2024"' if key == "output" else '="photo (1).png","2024"'), whole
    for name in ("a, b", "a=b", "[1]", "{2}.png", "~3", "e#f.png"):  # only as files and folders, and in lists
        (tmp_path / name).mkdir(exist_ok=True)
        (word,) = expand_arguments([f"data={name}"])
        assert parse_value(word.partition("=")[2]) == [name], word
        assert expand_positional(name) == f"image={name}"
    (tmp_path / "steps=3").mkdir()
    assert expand_positional("steps=3") == "steps=3", "a key is one, though a folder has its name"
    (tmp_path / "steps=4").mkdir(exist_ok=True)
    for name in ("steps=4/x.png", "look=ink.png"):
        (tmp_path / name).touch()
        assert expand_positional(name) == f"image={name}", "but no file"
    (tmp_path / "{best}.png").touch()
    assert expand_arguments(["style={best}.png"])[0].startswith("style.image=")
    (tmp_path / "~nosuchuser").mkdir()
    assert name_of("~nosuchuser") == "~nosuchuser"
    (tmp_path / "null").write_text("")
    if key not in ("image", "output", "catalogue"):
        refuses(r"=null is ambiguous: a file has that name; type .*=\./null", expand_arguments, [f"{key}=null"])


@pytest.mark.parametrize("name", ["${x}", "x${", "a\\${look}", 'a"${seed}', "b\\"])
def test_a_name_stays_itself_however_often_it_is_resolved(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    node = OmegaConf.create({"twice": parse_value(compose.quote(literal(name)))})
    OmegaConf.resolve(node)  # as Hydra does before it builds a sweeper
    assert node.twice == name
    (tmp_path / name).mkdir()
    Image.new("RGB", (64, 48)).save(tmp_path / name / "a.png")
    (word,) = (word for word in expand_pictures([f"image={name}"], False) if word.startswith("output="))
    assert "${" not in word, "Hydra cannot write there"
    Image.new("RGB", (64, 48)).save(tmp_path / f"{name}.png")
    cfg = compose.compose_config(expand_arguments([f"image={name}.png", f"style={name}.png", f"focus={name}.png"]))
    assert (cfg.image, cfg.focus) == (f"{name}.png",) * 2
    assert options_in(cfg.style.loss, "style.loss")["image"] == f"{name}.png"
    assert f"{name}.png" == compose.compose_config(expand_arguments(["export", f"{name}.png"])).catalogue


def test_where_nothing_can_be_written_is_told_and_a_number_is_no_path(tmp_path, monkeypatch):
    (tmp_path / "a${b}").mkdir()
    monkeypatch.chdir(tmp_path / "a${b}")
    assert "name contains ${; change to another folder" in str(explain_grammar_error("Interpolation key 'b' not found"))
    assert expand_arguments(["strokes=10"]) == ["strokes=10"]
    assert "strokes" in keys_of(TASKS["score"]), "where it is a file"


@pytest.mark.parametrize(("words", "remark"), [
    ("detail=2 strokes=20", "strokes overrides detail; type only one of them"),
    ("max_strokes=9 pixels_per_stroke=50 strokes=20", "strokes overrides pixels_per_stroke, max_strokes; type"),
    ("steps=5 seconds=3", "seconds overrides steps;"),
    ("effort=2 steps=3", "steps overrides effort;"),
    ("look=plain focus_strength=3", "focus_strength has no effect without focus="),
    ("frames=0 timelapse=gif", "timelapse has no effect without frames="),
    ("light.depth=0 light.gloss=1", "light.gloss has no effect without light.depth="),
    ("style.colors=content", "style.colors has no effect without style.image="),
])  # fmt: skip
def test_keys_that_would_do_nothing_are_told(config, caplog, words, remark):
    words = ["image=moon", "resolution=32", *words.split()]
    check(config(*words), words)
    assert remark in caplog.text
    caplog.clear()
    words = [*words[:2], "detail=2", "focus=auto", "focus_strength=3", "light.depth=1", "light.gloss=1", "effort=1"]
    check(config(*words), words)
    assert "no effect" not in caplog.text
