"""The tree is the architecture: the map names real modules, and plugins know only contracts."""

import ast
from pathlib import Path

import pytest

from brushexp import painting, training
from brushexp.app.schema import TASKS
from brushexp.registry import FAMILIES, PACKAGES

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "src" / "brushexp"
# What any plugin may import, besides the contracts of the families and the private modules of its own.
SHARED = {
    "compositing.bands",
    "compositing.rasterization",
    "compositing.eager",
    "compositing.layers",
    "compositing.profile",
    "compositing.textured_profile",
    "compositing.textures",
    "compositing.tile_lists",
    "compositing.windows",
    "bounds",
    "registry",
    "errors",
    "system.files",
    "pictures.color",
    "pictures.focus",
    "pictures.load",
    "pictures.structure",
    "pictures.video",
    "system.process",
    "shading.height",
    "shading.light",
    "system.checkpoint",
    "system.compiled",
    "pictures.region",
    "strokes.catalogue",
    "strokes.bezier",
    "strokes.prior",
    "strokes.brushwork",
    "strokes.neighbours",
    "strokes.text",
    "features",
    "features.base",
    "features.context",
}


def imports(path: Path) -> set[str]:
    """Modules of brushexp that a file imports, without the leading ``brushexp.``."""
    nodes = (node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.ImportFrom))
    found = set()
    for node in nodes:
        if (node.module or "").startswith("brushexp."):
            module = node.module.removeprefix("brushexp.")
            is_package = (SOURCE / module.replace(".", "/")).is_dir() and module not in SHARED
            found |= {f"{module}.{alias.name}" for alias in node.names} if is_package else {module}
    return found


@pytest.mark.parametrize("path", [painting, training], ids=lambda path: path.__name__)
def test_the_map_names_every_module_of_the_path(path):
    line = " ".join(path.__doc__.splitlines()[2:])
    steps = {step.strip() for step in line.replace("(with", "->").replace(")", "").replace(",", "->").split("->")} - {
        ""
    }
    modules = {file.stem for file in Path(path.__file__).parent.glob("*.py")} - {"__init__"}
    assert modules <= steps, f"not on the map: {modules - steps}"
    assert steps <= modules | set(FAMILIES), f"on the map only: {steps - modules - set(FAMILIES)}"


@pytest.mark.parametrize("family", FAMILIES)
def test_plugins_know_only_contracts(family):
    contracts = {f"plugins.{PACKAGES.get(other, other)}.base" for other in FAMILIES}
    folder = SOURCE / "plugins" / PACKAGES.get(family, family)
    for path in folder.glob("*.py"):
        own = {f"plugins.{folder.name}.{other.stem}" for other in folder.glob("*.py")}
        extra = imports(path) - SHARED - contracts - own
        assert not extra, f"{path.name} reaches into {extra}; pass it what it needs instead"


@pytest.mark.parametrize("family", FAMILIES)
def test_every_family_is_a_package_with_a_contract(family):
    folder = SOURCE / "plugins" / PACKAGES.get(family, family)
    assert (folder / "base.py").is_file()
    assert f"{family}=" in (folder / "__init__.py").read_text()


def test_no_preset_has_the_name_of_a_plugin():
    from brushexp.registry import plugins  # noqa: PLC0415

    for family in FAMILIES:
        presets = {path.stem for path in (ROOT / "conf" / family).glob("*.yaml")}
        assert not presets & {plugin.name for plugin in plugins(family)}


def test_every_task_has_a_module_and_a_schema():
    assert {path.stem for path in (SOURCE / "app" / "tasks").glob("*.py")} - {"__init__"} == set(TASKS)
