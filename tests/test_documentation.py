"""Tests of the documentation: commands compose, files exist, and the examples and the notebook run."""

import doctest
import os
import re
import shlex
import subprocess
import sys
import textwrap
import tomllib
from importlib import import_module
from pathlib import Path

import nbformat
import numpy as np
import pytest
import yaml
from catalogues import catalogue
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import ConfigCompositionException
from omegaconf import OmegaConf
from program import ROOT, publish
from refusals import refuses
from skimage import data, io
from typed import configured

from brushexp.bounds import Bounds
from brushexp.cli.program import expand_arguments
from brushexp.config import compose
from brushexp.config.check import check, check_chosen, check_names, nodes_of
from brushexp.config.compose import folders_of
from brushexp.config.keys import keys_of
from brushexp.config.publish import offer_presets, prepare
from brushexp.config.tasks import TASKS
from brushexp.pictures.decode import read_picture
from brushexp.pictures.similarity import psnr_of
from brushexp.registry import FAMILIES, MULTI_SELECT, build, plugin_of
from brushexp.strokes.storage import save_catalogue
from brushexp.system.status import Status

PAGES = [*sorted(ROOT.glob("*.md")), *sorted((ROOT / "docs").rglob("*.md"))]
WRITTEN_BY_TASKS = ("ablations.md", "leaderboard.md")
LONGEST_LINE = 120  # characters per line of text; tables and code may be longer
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
PACKAGES = {
    re.match(r"[\w-]+", requirement).group()
    for group in (PROJECT["dependencies"], *PROJECT["optional-dependencies"].values())
    for requirement in group
} - {"brushexp"}
NAVIGATION = yaml.safe_load((ROOT / "mkdocs.yml").read_text())["nav"]
GUIDE = next(part["Guide"] for part in NAVIGATION if "Guide" in part)
CHECKED_PAGES = [ROOT / "README.md", *(ROOT / "docs" / name for page in GUIDE for name in page.values())]
STROKES_PER_BLOCK = re.compile(r"^ {4,}(?:.* && )?(?:\S*bin/)?brushexp(?: (.*?))?(?:  +#.*)?$", re.MULTILINE)
IN_A_LINE = re.compile(r"`brushexp\s([^`]+)`")  # may continue on the next line


def commands_of(pages, *patterns):
    """Map the arguments of every command in the pages to a test name that includes the page's name."""
    return {
        " ".join(command.split()): f"{page.name}: {command}"
        for page in pages
        for pattern in patterns
        for command in pattern.findall(page.read_text())
    }


CHECKED = commands_of(CHECKED_PAGES, STROKES_PER_BLOCK, IN_A_LINE)
CHECKED.pop("doctor", None)  # not a task; tests/test_doctor.py runs it
SHOWN = {command: name for command, name in commands_of(PAGES, STROKES_PER_BLOCK).items() if command not in CHECKED}


def first_of(override):
    """Return the first value of a swept override, or the lower end of an interval."""
    return override.value().start if override.is_interval_sweep() else next(override.sweep_string_iterator())


def config_of(command, folder):
    """Compose the config of a command, or of a sweep's first job, in a folder with two photographs."""
    for photo in ("a.jpg", "1887/b.jpg"):
        (folder / "photos" / photo).parent.mkdir(parents=True, exist_ok=True)
        (folder / "photos" / photo).touch()
    words = [word for word in shlex.split(command, comments=True) if word not in ("-m", "--multirun", "--help")]
    flags = ["-m"] * ("-m" in command.split())
    overrides = OverridesParser.create().parse_overrides(
        [word for word in expand_arguments([*flags, *words]) if not word.startswith("-")]
    )
    plain = [
        f"{one.get_key_element()}={first_of(one)}" if one.is_sweep_override() else one.input_line
        for one in overrides
        if not one.key_or_group.startswith("hydra.")
    ]
    return configured(plain)


@pytest.mark.parametrize("command", SHOWN, ids=SHOWN.values())
def test_a_command_that_another_page_shows_composes(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    config_of(command, tmp_path)


def check_bounds(bounds, name, value):
    """Check a value against its bounds; skip rules, because they may read files that do not exist here."""
    if isinstance(bounds, Bounds):
        bounds.check(name, OmegaConf.to_object(value) if OmegaConf.is_config(value) else value)


@pytest.mark.parametrize("command", CHECKED, ids=CHECKED.values())
def test_a_command_of_the_guide_is_complete_and_its_values_are_in_their_bounds(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    cfg = config_of(command, tmp_path)
    check_names(cfg)
    check_chosen(cfg)
    for name, key in keys_of(TASKS[cfg.task]).items():
        assert not OmegaConf.is_missing(cfg, name)
        check_bounds(key.bounds, name, OmegaConf.select(cfg, name))
    for path, node in nodes_of(cfg):
        plugin = plugin_of(node)
        assert set(node) <= {"_target_", *plugin.meanings}
        for option, bounds in plugin.bounds.items():
            check_bounds(bounds, f"{path}.{option}", node[option])


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_lines_of_text_are_short_and_files_of_the_program_that_a_page_names_exist(page):
    if page.name not in WRITTEN_BY_TASKS:
        text = [line for line in page.read_text().splitlines() if not line.startswith(("|", "    "))]
        assert not [line for line in text if len(line) > LONGEST_LINE]
    roots = [ROOT, ROOT / "src" / "brushexp", *(ROOT / "packages").glob("*/brushexp_*")]
    names = re.findall(r"(?<![\w/])([\w-]+/[\w./-]+\.(?:py|yaml))\b", page.read_text())
    own = [name for name in names if not name.startswith(("conf/", "plugins/"))]  # of the program, not of a user
    assert not [name for name in own if not any((root / name).is_file() for root in roots)]


def test_a_reason_and_the_version_that_was_tried_are_given_for_every_dependency():
    table = (ROOT / "docs" / "decisions" / "014-dependencies.md").read_text().partition("## Packages")[2]
    names = re.sub(r"\(.*?\)", "", "\n".join(re.findall(r"^\| (.*?) \|", table, re.MULTILINE)[1:]))
    assert {name.strip() for name in re.split(r"[,\n]", names)} == PACKAGES
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    assert {line.partition("==")[0] for line in lines if "==" in line} == PACKAGES


def test_the_page_about_installing_names_every_extra_and_what_it_installs():
    page = (ROOT / "docs" / "index.md").read_text().partition("### Extras")[2].partition("\n### ")[0]
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in page.splitlines() if line.startswith("| `")]
    extras = {name: libraries for names, _, libraries in rows for name in re.findall(r"`(\w+)`", names)}
    assert extras.keys() == PROJECT["optional-dependencies"].keys()
    for name in extras.keys() - {"test", "docs", "dev"}:
        needed = {re.match(r"[\w-]+", text).group() for text in PROJECT["optional-dependencies"][name]}
        assert set(extras[name].split(", ")) == needed, name


SOURCE = ROOT / "src"
FOLDERS = [SOURCE, *ROOT.glob("packages/*")]
MODULES = {path: folder for folder in FOLDERS for path in folder.rglob("*.py") if ">>> " in path.read_text()}


def test_every_contract_has_an_example_and_the_loop_on_the_page_about_python_runs():
    contracts = [*SOURCE.glob("brushexp/plugins/*/base.py"), SOURCE / "brushexp/strokes/catalogue.py"]
    assert len(contracts) > 10
    assert not [path for path in contracts if path not in MODULES]
    assert doctest.testfile(str(ROOT / "docs/api.md"), module_relative=False).failed == 0


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(ROOT)))
def test_examples_in_docstrings_run(path):
    module = import_module(".".join(path.relative_to(MODULES[path]).with_suffix("").parts))
    result = doctest.testmod(module)
    assert result.attempted > 0
    assert result.failed == 0


def test_the_plain_loop_paints_a_picture(tmp_path):
    io.imsave(tmp_path / "photo.png", data.coffee()[::8, ::8], check_contrast=False)
    words = [sys.executable, str(ROOT / "examples" / "plain_loop.py"), "photo.png", "painting.png"]
    said = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=True).stdout
    first, *_, last = map(float, re.findall(r"([\d.]+) dB", said))
    picture, painting = (read_picture(tmp_path / name).astype(float) for name in ("photo.png", "painting.png"))
    assert psnr_of(np.square((picture - painting) / 255).mean()) > last - 0.1 > first + 5


def test_the_page_about_files_names_every_status():
    (row,) = re.findall(r"^\| `status` .*", (ROOT / "docs" / "formats.md").read_text(), re.MULTILINE)
    assert {*re.findall("`(.*?)`", row)} == {"status", *Status}


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # Jupyter's own
def test_the_notebook_runs(tmp_path):
    from nbclient import NotebookClient  # noqa: PLC0415

    book = nbformat.read(ROOT / "docs" / "notebook.ipynb", as_version=4)
    NotebookClient(book, timeout=200, resources={"metadata": {"path": str(tmp_path)}}).execute()
    shown, figures, states, gradient = (cell.outputs for cell in book.cells if cell.cell_type == "code")
    assert "<iframe" in shown[-1]["data"]["text/html"]
    assert "(400, 400, 3)" in figures[-1]["data"]["text/plain"]
    assert "30 of 30" in "".join(output["text"] for output in states)  # it arrives in pieces
    assert "2])" in gradient[-1]["data"]["text/plain"]
    assert not [*tmp_path.iterdir()]


TEXT = (ROOT / "docs" / "tutorial.md").read_text()
BLOCKS = {
    name: textwrap.dedent(block)
    for block, name in re.findall(r"((?:^    # (\S+)\n)(?:^(?:    .*)?\n)+)", TEXT, re.MULTILINE)
}
NAMES = {Path(name).stem for name in BLOCKS if name.endswith(".py")}
PACKAGE = ROOT / "examples" / "plugin-package"


def test_there_is_an_example_of_every_family_and_the_tutorial_names_it():
    files = {path.name: path.read_text() for path in (ROOT / "examples" / "plugins").glob("*.py")}
    assert set(re.findall(r'@register\("(\w+)"', "".join([*files.values(), *BLOCKS.values()]))) == set(FAMILIES)
    rows = dict(re.findall(r"^\| `(\w+\.py)` \| `(\w+)` \|", (ROOT / "docs/tutorial.md").read_text(), re.MULTILINE))
    assert rows == {name: re.search(r'@register\("(\w+)"', text)[1] for name, text in files.items()}


@pytest.mark.slow
def test_the_plugins_of_the_tutorial_and_of_the_package_keep_their_contracts(tmp_path):
    assert {"calm"} == NAMES
    examples = [path.stem for path in (ROOT / "examples" / "plugins").glob("*.py")]
    for name in NAMES:
        (tmp_path / f"{name}.py").write_text(BLOCKS[f"plugins/{name}.py"])
    command = [sys.executable, "-m", "pytest", "-n", "0", "-p", "no:cacheprovider"]
    command += ["-k", " or ".join([*NAMES, *examples, "dabs"]), "tests/test_plugins.py", str(PACKAGE)]
    project = tomllib.loads((PACKAGE / "pyproject.toml").read_text())["project"]
    publish(tmp_path, project["name"], project["version"], project["entry-points"]["brushexp.plugins"])
    path = [str(tmp_path), str(PACKAGE / "src"), os.environ.get("PYTHONPATH", "")]
    environment = os.environ | {
        "BRUSHEXP_PLUGINS": f"{tmp_path}{os.pathsep}{ROOT / 'examples' / 'plugins'}",
        "PYTHONPATH": os.pathsep.join(path),
    }
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-4000:]
    assert int(re.search(r"(\d+) passed", done.stdout)[1]) >= 56


PRESETS = {
    "loss/mse_strong": BLOCKS["conf/loss/mse_strong.yaml"],
    "loss/stronger": "defaults: [mse_strong]\nweight: 3.0\n",
    "loss/own_package": "# @package loss.own_package\ndefaults: [mse@_here_, _self_]\nweight: 4.0\n",
    "loss/both": "defaults: [mse, l1, _self_]\nmse:\n  weight: 5.0\n",
    "metric/likeness": "defaults: [ssim]\n",
    "to/large": "defaults: [png]\n",
    "logger/table": "defaults: [csv]\n",
    "callbacks/rates": "defaults: [learning_rate_monitor]\n",
    "change/much": "defaults: [variety]\namount: 0.9\n",
}


@pytest.fixture
def presets(tmp_path, hydra_restore_singletons):
    """Write presets for the families that allow several choices, and return their config folders."""
    for name, text in PRESETS.items():
        path = tmp_path / "conf" / f"{name}.yaml"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    prepare(tmp_path)
    return folders_of(tmp_path)


def composed(folders, *overrides):
    cfg = compose.compose_config(overrides, folders)
    check(cfg)
    return cfg


WEIGHTS = {
    "[mse,mse_strong]": {"mse": 1.0, "mse_strong": 2.0},
    "stronger": {"stronger": 3.0},
    "own_package": {"own_package": 4.0},
    "both": {"mse": 5.0, "l1": 1.0},
}


def test_a_preset_of_a_loss_is_one_of_that_name_typed_and_tuned_as_its_plugin_in_every_family_of_several(
    presets, tmp_path
):
    for chosen, weights in WEIGHTS.items():
        cfg = composed(presets, f"loss={chosen}")
        assert {name: node.weight for name, node in cfg.loss.items()} == weights
        assert all(build(node).weight == weights[name] for name, node in cfg.loss.items())
    assert composed(presets, "loss=mse_strong", "loss.mse_strong.weight=7").loss.mse_strong.weight == 7.0
    with pytest.raises(ConfigCompositionException):
        composed(presets, "loss=mse_strong", "loss.mse_strong.weight=much")
    words = r"loss\.mse_strong\.weight=-1 is not at least 0"
    refuses(words, composed, presets, "loss=mse_strong", "loss.mse_strong.weight=-1")
    save_catalogue(tmp_path / "a.h5", catalogue())
    cfg = composed(presets, "logger=[table,csv]", "callbacks=[rates]")
    assert composed(presets, "change=[much]").change.much.amount == 0.9
    assert (list(cfg.logger), list(cfg.callbacks)) == (["table", "csv"], ["rates"])
    assert list(composed(presets, "task=export", "to=[large,svg]", f"catalogue={tmp_path}/a.h5").to) == ["large", "svg"]
    assert {path.partition("/")[0] for path in PRESETS} == set(MULTI_SELECT)


@pytest.mark.parametrize(("name", "text", "message"), [
    ("mse", "defaults: [l1]\n", "has the name of the plugin loss=mse; give the file another name"),
    ("odd", "defaults: [mse]\nwieght: 2.0\n", r"odd\.yaml does not fit loss=mse: .*wieght"),
    ("odd", "defaults: [mse]\nweight: much\n", r"odd\.yaml does not fit loss=mse: .*much"),
])  # fmt: skip
def test_a_preset_that_fits_no_plugin_is_refused(tmp_path, name, text, message):
    (tmp_path / f"{name}.yaml").write_text(text)
    refuses(message, offer_presets, "loss", {name: tmp_path / f"{name}.yaml"})
