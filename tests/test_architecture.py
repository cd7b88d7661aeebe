"""Tests of the architecture: no import cycles, a complete map, and plugins that need only contracts and libraries."""

import ast
import inspect
import subprocess
import sys
from graphlib import TopologicalSorter
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules

import brushexp_training
import pytest
from program import ROOT, run
from skimage import data, io

from brushexp import contracts, painting
from brushexp.config.tasks import TASKS
from brushexp.registry import FAMILIES, FOLDERS, plugins

SOURCE = ROOT / "src" / "brushexp"
LIBRARIES = {"compat", "compositing", "features", "pictures", "shading", "strokes", "system"}  # for plugins
TOOLS = {"registry", "errors", "bounds"}


def imports(path: Path) -> set[str]:
    """Return the brushexp modules that a file imports, without the prefix ``brushexp.``.

    For an import from a package, each imported name is appended to the package's name.
    """
    nodes = (node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.ImportFrom))
    found = set()
    for node in nodes:
        if (node.module or "").startswith("brushexp."):
            module = node.module.removeprefix("brushexp.")
            is_package = (SOURCE / module.replace(".", "/")).is_dir()
            found |= {f"{module}.{alias.name}" for alias in node.names} if is_package else {module}
    return found


def modules() -> dict[str, Path]:
    return {".".join(path.relative_to(SOURCE).with_suffix("").parts): path for path in sorted(SOURCE.rglob("*.py"))}


def imports_by(room) -> dict[str, set[str]]:
    """Group modules by ``room``, and map each group to those it imports, also in functions and for types."""
    names, found = modules(), {}
    for name, path in names.items():
        inner = {module for module in imports(path) if module in names or f"{module}.__init__" in names}
        others = {room(module) for module in inner} - {room(name)}
        found.setdefault(room(name), set()).update(others)
    return found


ROOMS = {
    "module": lambda name: name,
    "folder": lambda name: name.rpartition(".")[0] or name,
    "top": lambda name: name.partition(".")[0],
}


@pytest.mark.parametrize("room", ROOMS)
def test_no_imports_go_in_circles(room):
    graph = imports_by(ROOMS[room])
    graph.pop("", None)
    TopologicalSorter(graph).prepare()  # raises CycleError with the cycle


@pytest.mark.parametrize(
    "package", sorted(path.parent for path in ROOT.glob("packages/*/*/__init__.py")), ids=lambda path: path.name
)
def test_no_imports_go_in_circles_within_a_package(package):
    names = {".".join(path.relative_to(package.parent).with_suffix("").parts): path for path in package.rglob("*.py")}
    trees = {name: ast.walk(ast.parse(path.read_text())) for name, path in names.items()}
    graph = {name: {node.module for node in tree if isinstance(node, ast.ImportFrom)} for name, tree in trees.items()}
    TopologicalSorter({name: taken & graph.keys() for name, taken in graph.items()}).prepare()


def test_layers_of_the_design_are_those_of_the_imports():
    table = (ROOT / "docs" / "design.md").read_text().partition("## 3. ")[2].partition("`src/hydra_plugins`")[0]
    rows = [line.split("|")[1] for line in table.splitlines() if line.startswith("| `")]  # without the header
    order = [word for row in rows for word in row.replace("`", " ").replace(",", " ").split()]
    graph = imports_by(ROOMS["top"])
    assert {path.stem for path in SOURCE.iterdir() if path.suffix == ".py" or (path / "__init__.py").is_file()} - {
        "__init__", "__main__", "conf",
    } == set(order)  # fmt: skip
    for place, name in enumerate(order):
        assert graph.get(name, set()) - {"conf"} <= set(order[:place]), name


def twice(found: dict[str, set[str]]) -> set[str]:
    return {name for name, places in found.items() if len(places) > 1}


def test_no_public_name_stands_twice_and_no_task_imports_a_task():
    names: dict[str, set[str]] = {}
    for path in SOURCE.rglob("*.py"):
        place = str(path.relative_to(SOURCE))
        for node in ast.parse(path.read_text()).body:
            public = isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_")
            if public and (node.name, path.parent.name) != ("run", "tasks"):
                names.setdefault(node.name, set()).add(place)
    assert not twice(names)
    for path in (SOURCE / "tasks").glob("*.py"):
        assert not {module for module in imports(path) if module.startswith("tasks")}, path.name


@pytest.mark.parametrize(
    "path", [*(SOURCE / "plugins").glob("*/*.py")], ids=lambda path: f"{path.parent.name}/{path.stem}"
)
def test_plugins_know_libraries_and_contracts_only(path):
    contracts = {f"plugins.{FOLDERS[family]}.base" for family in FAMILIES}
    for module in imports(path):
        package = module.partition(".")[0]
        own = module.startswith(f"plugins.{path.parent.name}.")
        assert package in LIBRARIES | TOOLS or module in contracts or own, f"{module}: pass it what it needs instead"


@pytest.mark.parametrize("folder", ["plugins", "examples"])
def test_examples_import_what_a_plugin_may(folder):
    for path in (ROOT / folder).rglob("*.py"):
        assert all(module.startswith(("contracts", "testing")) for module in imports(path)), path


def test_what_plugins_may_import_stands_at_one_place_and_is_explained():
    modules = [
        contracts,
        *(import_module(found.name) for found in iter_modules(contracts.__path__, f"{contracts.__name__}.")),
    ]
    names = [name for module in modules for name in module.__all__]
    assert len(names) == len(set(names))
    for module in modules[1:]:
        assert f"- `{module.__name__.rpartition('.')[2]}`: " in contracts.__doc__
        for thing in (getattr(module, name) for name in module.__all__):
            assert inspect.getdoc(thing) or not (inspect.isroutine(thing) or inspect.isclass(thing)), thing


@pytest.mark.parametrize("path", [painting, brushexp_training], ids=lambda path: path.__name__)
def test_the_map_names_every_module_of_the_path(path):
    line = " ".join(path.__doc__.splitlines()[2:])
    names = line.replace("(with", "->").replace(")", "").replace(",", "->").split("->")
    steps = {name.strip() for name in names} - {""}
    folder = Path(path.__file__).parent
    modules = {file.stem for file in folder.glob("*.py")} - {"__init__"}
    modules |= {inner.parent.name for inner in folder.glob("*/__init__.py")}
    assert modules <= steps, f"not on the map: {modules - steps}"
    assert steps <= modules | set(FAMILIES), f"on the map only: {steps - modules - set(FAMILIES)}"


@pytest.mark.parametrize("family", FAMILIES)
def test_every_family_is_a_package_with_a_contract_whose_members_stand_in_files_of_their_names(family):
    folder = SOURCE / "plugins" / FOLDERS[family]
    assert (folder / "base.py").is_file()
    assert f"{family}=" in (folder / "__init__.py").read_text()
    shipped = [plugin for plugin in plugins(family) if plugin.cls.__module__.startswith("brushexp.")]
    assert [plugin.cls.__module__.rpartition(".")[2] for plugin in shipped] == [plugin.name for plugin in shipped]


def test_no_preset_has_the_name_of_a_plugin_and_every_module_of_tasks_is_that_of_a_task():
    for family in FAMILIES:
        presets = {path.stem for path in (SOURCE / "conf" / family).glob("*.yaml")}
        assert not presets & {plugin.name for plugin in plugins(family)}
    modules = {task.module for task in TASKS.values() if task.module.startswith("brushexp.")}
    assert {f"brushexp.tasks.{path.stem}" for path in (SOURCE / "tasks").glob("*.py") if path.stem[0] != "_"} == modules


SPY = """
import sys
from brushexp.pictures import load

def spy(*_, **__):
    frame, names = sys._getframe(1), []
    while frame:
        names.append(frame.f_globals.get("__name__", ""))
        frame = frame.f_back
    print(*dict.fromkeys(name for name in reversed(names) if name.startswith("brushexp")))
    sys.exit()

load.read_picture = spy
"""


def test_few_modules_stand_between_a_word_and_the_picture_that_it_names_and_help_loads_nothing_slow(tmp_path):
    io.imsave(tmp_path / "photo.png", data.chelsea()[::8, ::8])
    (tmp_path / "plugins").mkdir()
    (tmp_path / "plugins" / "spy.py").write_text(SPY)
    found = run("photo.png", "look=plain", "output=run", cwd=tmp_path)
    (line,) = (line for line in found.stdout.splitlines() if line.startswith("brushexp"))
    assert line.split()[-1] == "brushexp.pictures.load"
    assert len(line.split()) <= 8, line
    command = [sys.executable, "-X", "importtime", "-m", "brushexp", "--help"]
    found = subprocess.run(command, capture_output=True, text=True, check=True)
    loaded = {line.rpartition("|")[2].strip() for line in found.stderr.splitlines()}
    assert "Most useful keys" in found.stdout
    assert "brushexp.registry" in loaded
    assert not loaded & {"lightning", "numba", "scipy.ndimage", "matplotlib"}
