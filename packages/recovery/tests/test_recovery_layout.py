"""Test that the package's folders follow the data flow, and that each imports only from earlier ones."""

import ast
import re
from pathlib import Path

import brushexp_recovery
import pytest

PACKAGE = Path(brushexp_recovery.__file__).parent
NAME = brushexp_recovery.__name__
FOLDERS = re.findall(r"^- `(\w+)`", brushexp_recovery.__doc__, re.MULTILINE)
MOST_MODULES = 15


def folders_imported_by(path: Path) -> set[str]:
    """List the package folders from which a module imports, even inside functions or only for type checking."""
    nodes = (node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.ImportFrom))
    modules = (node.module for node in nodes if (node.module or "").startswith(f"{NAME}."))
    return {module.split(".")[1] for module in modules}


def test_the_package_names_each_of_its_folders():
    assert sorted(FOLDERS) == sorted(path.parent.name for path in PACKAGE.glob("*/__init__.py"))


@pytest.mark.parametrize("folder", FOLDERS)
def test_a_folder_imports_from_those_before_it_and_says_what_goes_in_and_comes_out(folder):
    before = set(FOLDERS[: FOLDERS.index(folder)])
    for path in (PACKAGE / folder).rglob("*.py"):
        assert folders_imported_by(path) <= before | {folder}, path
        assert ast.get_docstring(ast.parse(path.read_text())), path
    assert len(list((PACKAGE / folder).glob("*.py"))) - 1 <= MOST_MODULES


def test_no_module_stands_outside_of_the_folders():
    assert [path.name for path in PACKAGE.glob("*.py")] == ["__init__.py"]
