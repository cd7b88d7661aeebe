"""Test that the sealed set is verified by checksums and painted only once unless a reason to repeat it is recorded."""

import hashlib
import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest
from brushexp_thesis.study_records import studies_in
from PIL import Image
from program import run

SCRIPT = Path(__file__).parents[3] / "benchmarks" / "sealed.py"
WORDS = ("experiment=kodak24", "strokes=4,6", "steps=2", "resolution=24", "threads=1", "logger=[]", "report=false")


@pytest.fixture
def sealed():
    spec = importlib.util.spec_from_file_location("sealed", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def listed(tmp_path):
    """Write two pictures into a folder, and list them with their checksums in a YAML file."""
    rng, lines = np.random.default_rng(0), []
    (tmp_path / "unpacked" / "deep").mkdir(parents=True)
    for name in ("a.png", "b.png"):
        path = tmp_path / "unpacked" / "deep" / name
        Image.fromarray(rng.integers(0, 255, (24, 32, 3), np.uint8)).save(path)
        lines.append(f"- {name}: {hashlib.sha256(path.read_bytes()).hexdigest()}")
    (tmp_path / "set.yaml").write_text("\n".join(lines))
    return tmp_path / "set.yaml"


def test_a_set_is_painted_once_and_again_only_with_a_reason(sealed, listed, tmp_path):
    sealed.collect(tmp_path / "unpacked", tmp_path / "pictures", listed)
    ran = []

    def call(words):
        ran.append(words)
        assert json.loads(listed.with_suffix(".json").read_text())[-1]["words"] == list(WORDS)  # noted in advance
        return run(*words[3:], cwd=tmp_path).returncode

    sealed.paint(tmp_path / "pictures", tmp_path / "out", listed=listed, words=WORDS, run=call)
    study = studies_in([tmp_path], tmp_path)["kodak24"]
    assert (study.units, study.n_finished) == (["a.png", "b.png"], 4)
    assert study.table["psnr"].notna().all()
    with pytest.raises(SystemExit, match=r"was painted on .* give the reason with --again REASON"):
        sealed.paint(tmp_path / "pictures", tmp_path / "again", listed=listed, words=WORDS, run=call)
    assert len(ran) == 1
    with pytest.raises(SystemExit, match="the run ended with 3"):
        sealed.paint(tmp_path / "pictures", tmp_path / "again", "a bug", listed, WORDS, lambda words: 3)
    assert [one["again"] for one in json.loads(listed.with_suffix(".json").read_text())] == ["", "a bug"]


def test_other_files_of_the_names_are_refused_before_the_set_counts_as_painted(sealed, listed, tmp_path):
    with pytest.raises(SystemExit, match=r"lacks a.png, b.png"):
        sealed.collect(tmp_path / "nowhere", tmp_path / "pictures", listed)
    sealed.collect(tmp_path / "unpacked", tmp_path / "pictures", listed)
    (tmp_path / "pictures" / "b.png").write_bytes(b"another")
    with pytest.raises(SystemExit, match=r"lacks files of set.yaml: b.png"):
        sealed.paint(tmp_path / "pictures", tmp_path / "out", listed=listed, words=WORDS)
    assert not listed.with_suffix(".json").exists()


def test_the_sealed_set_that_ships_is_in_no_other_set(sealed):
    digests = sealed.digests_in(sealed.LIST)
    assert len(digests) == len(set(digests.values())) == 22
    assert all(len(digest) == 64 for digest in digests.values())
    others = [path.read_text() for path in SCRIPT.parents[1].glob("packages/*/*/conf/pictures/*.yaml")]
    assert others
    assert not [name for name, digest in digests.items() for text in others if digest in text]
