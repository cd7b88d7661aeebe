"""The documentation is true of the program: its commands compose, its files exist, its examples and notebook run."""

import doctest
import re
import shlex
import tomllib
from importlib import import_module

import nbformat
import pytest
from hydra.core.override_parser.overrides_parser import OverridesParser
from program import ROOT
from typed import configured

from brushexp.cli.program import expand_arguments

PAGES = [*sorted(ROOT.glob("*.md")), *sorted((ROOT / "docs").rglob("*.md"))]
WRITTEN_BY_TASKS = ("ablations.md", "leaderboard.md")
LONGEST_LINE = 120  # characters of a line of text; tables and code may be longer
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
PACKAGES = {
    re.match(r"[\w-]+", requirement).group()
    for group in (PROJECT["dependencies"], *PROJECT["optional-dependencies"].values())
    for requirement in group
} - {"brushexp"}
SHOWN = {
    command: f"{page.name}: {command}"
    for page in PAGES
    for command in re.findall(r"^ {4}brushexp (.*?)(?:  +#.*)?$", page.read_text(), re.MULTILINE)
}


def first_of(override):
    """The first value of a sweep, or the lower end of an interval."""
    return override.value().start if override.is_interval_sweep() else next(override.sweep_string_iterator())


@pytest.mark.parametrize("command", SHOWN, ids=SHOWN.values())
def test_a_command_that_is_shown_composes(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "a.jpg").touch()
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
    configured(plain)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_lines_of_text_are_short(page):
    if page.name not in WRITTEN_BY_TASKS:
        text = [line for line in page.read_text().splitlines() if not line.startswith(("|", "    "))]
        assert not [line for line in text if len(line) > LONGEST_LINE]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_files_of_the_program_that_a_page_names_exist(page):
    roots = [ROOT, ROOT / "src" / "brushexp", *(ROOT / "packages").glob("*/brushexp_*")]
    names = re.findall(r"(?<![\w/])([\w-]+/[\w./-]+\.(?:py|yaml))\b", page.read_text())
    own = [name for name in names if not name.startswith(("conf/", "plugins/"))]  # of the program, not of a user
    assert not [name for name in own if not any((root / name).is_file() for root in roots)]


def test_a_reason_is_given_for_every_dependency():
    table = (ROOT / "docs" / "decisions" / "014-dependencies.md").read_text().partition("## Packages")[2]
    names = re.sub(r"\(.*?\)", "", "\n".join(re.findall(r"^\| (.*?) \|", table, re.MULTILINE)[1:]))
    assert {name.strip() for name in re.split(r"[,\n]", names)} == PACKAGES


def test_constraints_name_the_version_that_was_tried_of_every_dependency():
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    assert {line.partition("==")[0] for line in lines if "==" in line} == PACKAGES


SOURCE = ROOT / "src"
FOLDERS = [SOURCE, *ROOT.glob("packages/*")]
MODULES = {path: folder for folder in FOLDERS for path in folder.rglob("*.py") if ">>> " in path.read_text()}


def test_every_contract_has_an_example():
    contracts = [*SOURCE.glob("brushexp/plugins/*/base.py"), SOURCE / "brushexp/strokes/catalogue.py"]
    assert len(contracts) > 10
    assert not [path for path in contracts if path not in MODULES]


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(ROOT)))
def test_examples_in_docstrings_run(path):
    module = import_module(".".join(path.relative_to(MODULES[path]).with_suffix("").parts))
    result = doctest.testmod(module)
    assert result.attempted > 0
    assert result.failed == 0


def test_the_loop_on_the_page_about_python_runs():
    assert doctest.testfile(str(ROOT / "docs/api.md"), module_relative=False).failed == 0


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # of Jupyter's own
def test_the_notebook_runs(tmp_path):
    from nbclient import NotebookClient  # noqa: PLC0415

    book = nbformat.read(ROOT / "docs" / "notebook.ipynb", as_version=4)
    NotebookClient(book, timeout=200, resources={"metadata": {"path": str(tmp_path)}}).execute()
    shown, figures, states, gradient = (cell.outputs for cell in book.cells if cell.cell_type == "code")
    assert "<iframe" in shown[-1]["data"]["text/html"]
    assert "(400, 400, 3)" in figures[-1]["data"]["text/plain"]
    assert "30 of 30" in "".join(output["text"] for output in states)  # which comes in pieces
    assert "2])" in gradient[-1]["data"]["text/plain"]
    assert not [*tmp_path.iterdir()]
