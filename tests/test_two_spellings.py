"""Tests that an accented name finds the same file whether its accents are separate (NFD) or composed (NFC)."""

import os
import shutil
import unicodedata
from pathlib import Path

import numpy as np
import pytest
from catalogues import catalogue
from omegaconf import OmegaConf
from PIL import Image
from program import run

import brushexp
from brushexp.cli.many_pictures import pictures_named
from brushexp.cli.opening import open_with
from brushexp.cli.program import expand_arguments
from brushexp.config.vocabulary import spell_paths
from brushexp.pictures.folders import pictures_in
from brushexp.pictures.load import load_picture
from brushexp.strokes.storage import load_catalogue, save_catalogue
from brushexp.system.spellings import find_spelling

COMPOSED, DECOMPOSED = (unicodedata.normalize(form, "Gemälde Å") for form in ("NFC", "NFD"))
SPELLINGS = [(COMPOSED, DECOMPOSED), (DECOMPOSED, COMPOSED)]
PIXELS = np.zeros((12, 16, 3), np.uint8)


@pytest.fixture(params=SPELLINGS, ids=["there decomposed", "there composed"])
def names(request, tmp_path, monkeypatch):
    """Return two spellings of a name: the typed one, and the one on disk."""
    monkeypatch.chdir(tmp_path)
    return request.param


def picture(path: str) -> None:
    Image.fromarray(PIXELS).save(path)


KEYS = [
    *("image", "style", "style.image", "style.brushwork", "focus", "catalogue", "resume", "output", "lpips_weights"),
    *("data", "runs", "guides", "region", "canvas", "claims", "tubes", "published", "renderer.checkpoint", "path"),
    *("init.file", "renderer.files", "loss.style.image", "+callbacks.x.file", "hydra.sweep.dir", "nobody.knows.it"),
]


@pytest.mark.parametrize("key", KEYS)
def test_every_key_takes_both_spellings_of_a_file_or_folder(names, key):
    typed, there = names
    picture(f"{there}.png")
    os.makedirs(f"{there}/{there}")
    for path in (f"{typed}.png", typed, f"{typed}/", f"{typed}/{typed}", f"./{typed}/../{typed}.png"):
        expected = path.replace(typed, there)
        assert os.path.exists(expected)
        assert spell_paths(f"{key}={path}") == f"{key}={expected}"
        assert spell_paths(f"{key}={os.path.abspath(path)}") == f"{key}={os.path.abspath(expected)}"
        assert spell_paths(path) == expected


def test_each_part_of_a_list_is_found_and_what_is_not_there_stays_as_it_is_typed(names):
    typed, there = names
    picture(f"{there}.png")
    picture("b.png")
    for word in ("image={},b.png,{}", "renderer.files=[{},b.png]", "data=['{}']", 'image="{}"', "style={{image:{}}}"):
        assert spell_paths(word.format(f"{typed}.png", f"{typed}.png")) == word.format(f"{there}.png", f"{there}.png")
    for word in (f"image={typed}.jpg", f"title={typed}", typed, f"--{typed}", f"image=nowhere/{typed}.png", "é=é"):
        assert spell_paths(word) == word


def test_a_folder_to_write_into_that_is_there_is_taken_and_what_is_new_below_it_is_as_typed(names):
    typed, there = names
    os.mkdir(there)
    assert spell_paths(f"output={typed}/{typed}/run") == f"output={there}/{typed}/run"
    assert spell_paths(f"output=new {typed}") == f"output=new {typed}"


def test_a_file_that_is_there_as_it_is_typed_wins_and_of_two_others_none_is_chosen(names):
    typed, there = names
    for name in (typed, there):
        picture(f"{name}.png")
    assert spell_paths(f"image={typed}.png") == f"image={typed}.png"
    mixed = unicodedata.normalize("NFC", typed[:-1]) + unicodedata.normalize("NFD", "Å")
    if mixed not in names:
        assert find_spelling(f"{mixed}.png") == f"{mixed}.png"


def test_words_are_found_before_anything_else_looks_at_them(names):
    typed, there = names
    picture(f"{there}.png")
    os.mkdir(f"{there} of pictures")
    picture(f"{there} of pictures/{there}.png")
    assert f'image="{there}.png"' in expand_arguments(open_with([f"{typed}.png"]))
    assert any(there in word and "pictures=" in word for word in expand_arguments(open_with([f"{typed} of pictures"])))


def test_readers_find_what_configs_and_lists_name(names, tmp_path):
    typed, there = names
    os.mkdir(there)
    picture(f"{there}/{there}.png")
    save_catalogue(Path(there, "catalogue.h5"), catalogue())
    assert load_picture(f"{typed}/{typed}.png", 8).shape == (3, 6, 8)
    assert len(load_catalogue(Path(typed)).strokes) == len(load_catalogue(Path(typed, "catalogue.h5")).strokes)
    assert pictures_in(f"{typed}*/*.png") == [f"{there}/{there}.png"]
    assert pictures_in(f"*/{typed[:-2]}*.png") == [f"{there}/{there}.png"]
    Path("conf/pictures").mkdir(parents=True)
    OmegaConf.save(OmegaConf.create([f"{typed}.png"]), "conf/pictures/set.yaml")
    shutil.copy(f"{there}/{there}.png", f"conf/pictures/{there}.png")
    found = pictures_named("set", [tmp_path / "conf"])
    assert found == [str(tmp_path / "conf" / "pictures" / f"{there}.png")]


def test_python_finds_them_too(names, tmp_path):
    typed, there = names
    os.mkdir(there)
    picture(f"{there}/{there}.png")
    options = {"look": "plain", "strokes": 5, "steps": 1, "resolution": 16}
    painting = brushexp.paint(f"{typed}/{typed}.png", focus=f"{typed}/{typed}.png", **options)
    painting.export("json", typed)
    assert sorted(os.listdir(there)) == [f"{there}.png", "strokes.json"]
    painting.save(typed)
    brushexp.paint(PIXELS, output=f"{typed}/run", **options)
    assert Path(there, "run", "painting.png").is_file()
    assert os.listdir(tmp_path) == [there]


@pytest.mark.slow
@pytest.mark.parametrize(("typed", "there"), SPELLINGS)
def test_a_run_is_painted_exported_and_looked_for_by_either_spelling(tmp_path, typed, there):
    picture(str(tmp_path / f"{there}.png"))
    (tmp_path / there).mkdir()
    words = ["strokes=9", "steps=1", "resolution=16", "frames=0", "report=false"]
    for overrides in ([f"{typed}.png", f"output={typed}", *words], ["task=export", typed, "to=json", "output=there"]):
        done = run(*overrides, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
    assert (tmp_path / there / "painting.png").is_file()
    assert (tmp_path / "there" / "strokes.json").is_file()
    assert not {"painting.png", typed} & {path.name for path in tmp_path.iterdir()}
    done = run(f"{typed}.png", f"output={typed}", *words, cwd=tmp_path)
    assert "already holds a run" in done.stderr
