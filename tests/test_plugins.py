"""The contract of each family, checked for every registered plugin and preset, yours included."""

import pytest

from brushexp.app.configs import SHIPPED
from brushexp.registry import FAMILIES, MULTI_SELECT, build, build_named, plugins
from brushexp.testing import contract

TASK_OF = {"engine": "simulate", "to": "export"}  # families that the config of task=paint does not have


def names(family: str) -> list[str]:
    """Plugins and presets of a family."""
    presets = [path.stem for path in (SHIPPED / family).glob("*.yaml")]
    return sorted([plugin.name for plugin in plugins(family)] + presets)


@pytest.mark.parametrize("plugin", plugins(), ids=lambda plugin: f"{plugin.family}={plugin.name}")
def test_every_plugin_says_in_one_line_what_it_is(plugin):
    assert 10 <= len(plugin.summary) <= 200
    assert plugin.summary.rstrip(".:;") != plugin.cls.__name__


CHOICES = [(family, name) for family in FAMILIES for name in names(family)]


@pytest.mark.parametrize(("family", "name"), CHOICES, ids=map("=".join, CHOICES))
def test_the_options_of_a_choice_are_typed_and_it_keeps_the_contract_of_its_family(config, family, name, monkeypatch):
    monkeypatch.setenv("WANDB_MODE", "offline")
    cfg = config(*[f"task={TASK_OF.get(family)}"] * (family in TASK_OF), f"{family}={name}")
    node = cfg[family][name] if family in MULTI_SELECT else cfg[family]
    assert "_target_" in node
    for check in contract(family):
        check(lambda **options: build_named(family, name, options) if options else build(node))
