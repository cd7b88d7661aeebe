"""The examples in docstrings do what they show."""

import doctest
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
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
