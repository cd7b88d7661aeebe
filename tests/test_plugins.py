"""The contract of each family, checked for every registered plugin and preset, yours included."""

import pytest
from omegaconf import DictConfig, OmegaConf

from brushexp.config.vocabulary import SHIPPED
from brushexp.registry import FAMILIES, MULTI_SELECT, build, plugins
from brushexp.testing import contract

TASK_OF = {"engine": "simulate", "to": "export"}  # families that the config of task=paint does not have


def names(family: str) -> list[str]:
    """Plugins and presets of a family."""
    presets = [path.stem for path in (SHIPPED / family).glob("*.yaml")]
    return sorted([plugin.name for plugin in plugins(family)] + presets)


NODES: dict[tuple[str, str], DictConfig] = {}


def node_of(config, family: str, name: str) -> DictConfig:
    """The options of a choice, composed once; those of which several may be chosen all together."""
    if (family, name) not in NODES:
        several = family in MULTI_SELECT
        typed = f"{family}=[{','.join(names(family))}]" if several else f"{family}={name}"
        node = config(f"task={TASK_OF.get(family, 'paint')}", typed)[family]
        NODES.update({(family, key): value for key, value in node.items()} if several else {(family, name): node})
    return NODES[family, name]


@pytest.mark.parametrize("plugin", plugins(), ids=lambda plugin: f"{plugin.family}={plugin.name}")
def test_every_plugin_says_in_one_line_what_it_is(plugin):
    assert 10 <= len(plugin.summary) <= 200
    assert plugin.summary.rstrip(".:;") != plugin.cls.__name__


@pytest.mark.parametrize("family", FAMILIES)
def test_the_options_of_every_choice_are_typed(config, family):
    for name in names(family):
        assert "_target_" in node_of(config, family, name)


CASES = [(family, name, check) for family in FAMILIES for name in names(family) for check in contract(family)]


@pytest.mark.parametrize(("family", "name", "check"), CASES, ids=[f"{f}={n}-{c.__name__}" for f, n, c in CASES])
def test_a_plugin_keeps_the_contract_of_its_family(config, family, name, check, monkeypatch):
    monkeypatch.setenv("WANDB_MODE", "offline")

    def make(**options):
        return build(OmegaConf.merge(node_of(config, family, name), options))

    check(make)
