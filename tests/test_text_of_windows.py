"""Tests that text files from any system are read: with a byte order mark, in UTF-16, or with other line endings."""

import codecs
from pathlib import Path

import pytest
from omegaconf import OmegaConf
from program import run
from refusals import refuses

from brushexp.cli.help import help_text
from brushexp.cli.many_pictures import pictures_named
from brushexp.config.check import check
from brushexp.config.compose import compose_config, folders_of
from brushexp.config.publish import prepare
from brushexp.system.reading import decode_text, read_text

TEXTS = {
    "look/mine": "# @package _global_\n# größer\nchange:\n  variety:\n    amount: 0.2\n",
    "experiment/study": "# @package _global_\n# eine Studie\ndefaults:\n  - override /look: mine\nstrokes: 33\n",
    "quality/slow": "# @package _global_\n# langsam\neffort: 3\n",
    "loss/strong": "# stark\ndefaults: [mse]\nweight: 3.0\n",
    "loss/both": "# beide\ndefaults: [mse, l1, _self_]\nmse:\n  weight: 5.0\n",
    "to/fine": "defaults: [svg]\ndigits: 4\n",
    "pictures/set": "# Bilder\n- coffee\n- chelsea\n",
}
WAYS = {
    "mark": lambda text: codecs.BOM_UTF8 + text.encode(),
    "mark and CRLF": lambda text: codecs.BOM_UTF8 + text.replace("\n", "\r\n").encode(),
    "CRLF": lambda text: text.replace("\n", "\r\n").encode(),
    "CR": lambda text: text.replace("\n", "\r").encode(),
    "UTF-16 LE": lambda text: codecs.BOM_UTF16_LE + text.replace("\n", "\r\n").encode("utf-16-le"),
    "UTF-16 BE": lambda text: codecs.BOM_UTF16_BE + text.encode("utf-16-be"),
}


def write(folder: Path, way: str) -> None:
    for name, text in TEXTS.items():
        path = folder / "conf" / f"{name}.yaml"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(WAYS[way](text))


@pytest.mark.parametrize("way", WAYS)
def test_every_kind_of_config_is_read_as_windows_writes_it(tmp_path, way, hydra_restore_singletons):
    write(tmp_path, way)
    prepare(tmp_path)
    folders = folders_of(tmp_path)
    cfg = compose_config(["experiment=study", "quality=slow", "loss=[strong]"], folders)
    check(cfg)
    assert (cfg.change.variety.amount, cfg.strokes, cfg.loss.strong.weight) == (0.2, 33, 3.0)
    assert cfg.steps == compose_config(["look=mine", "effort=3"], folders).steps
    cfg = compose_config(["look=mine", "loss=both"], folders)
    assert {name: node.weight for name, node in cfg.loss.items()} == {"mse": 5.0, "l1": 1.0}
    assert compose_config(["task=export", "to=[fine]", "catalogue=x"], folders).to.fine.digits == 4
    assert pictures_named("set", folders) == ["coffee", "chelsea"]
    text = help_text(compose_config(["look=plain"], folders), ["look=plain", "quality=draft", "loss=mse"], folders)
    for words in ("größer", "langsam", "stark", "beide"):
        assert words in text


@pytest.mark.slow
def test_a_run_says_where_its_configs_with_marks_came_from_and_is_repeated_by_them(tmp_path):
    write(tmp_path, "mark and CRLF")
    words = ["coffee", "look=mine", "resolution=32", "strokes=9", "steps=1", "frames=0", "report=false"]
    done = run(*words, "output=run", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert OmegaConf.load(tmp_path / "run" / ".hydra" / "config.yaml").change.variety.amount == 0.2
    done = run("-m", *words, "seed=0,1", "output=sweep", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert OmegaConf.load(tmp_path / "sweep" / "1" / ".hydra" / "config.yaml").change.variety.amount == 0.2


def test_text_in_another_encoding_is_refused_with_what_would_do(tmp_path):
    (tmp_path / "a.yaml").write_bytes("größer: 1\n".encode("cp1252"))
    refuses(r"a\.yaml: not text in UTF-8; save it with that encoding$", read_text, tmp_path / "a.yaml", "")
    (tmp_path / "b.yaml").write_bytes(codecs.BOM_UTF16_LE + b"a")  # half a letter
    refuses(r"b\.yaml: not text in UTF-8", read_text, tmp_path / "b.yaml", "")


@pytest.mark.parametrize("text", ["", "a", "\n", "a\n\nb", "\ufeffa", "ä\r", "\r\n\r", "🖌"])
def test_a_mark_is_no_letter_of_a_text_but_where_it_stands_twice(text):
    lines = text.replace("\r\n", "\n").replace("\r", "\n")
    assert decode_text(text.encode()) == lines.removeprefix("\ufeff")
    for mark, encoding in ((codecs.BOM_UTF8, "utf-8"), (codecs.BOM_UTF16_LE, "utf-16-le")):
        assert decode_text(mark + text.encode(encoding)) == lines
