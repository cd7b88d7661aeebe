"""The contract of each family, checked for every registered plugin and preset, yours included."""

from itertools import zip_longest

import pytest
from brushexp_testing import contract
from omegaconf import DictConfig, OmegaConf

from brushexp.config.vocabulary import SHIPPED
from brushexp.registry import FAMILIES, MULTI_SELECT, build, plugins

TASK_OF = {"engine": "simulate", "to": "export"}  # families that the config of task=paint does not have


def names(family: str) -> list[str]:
    """Plugins and presets of a family."""
    presets = [path.stem for path in (SHIPPED / family).glob("*.yaml")]
    return sorted([plugin.name for plugin in plugins(family)] + presets)


NODES: dict[tuple[str, str], DictConfig] = {}


def node_of(config, family: str, name: str) -> DictConfig:
    """The options of a choice; a config has one of each family, and all of those of which several may be chosen."""
    for task in () if NODES else ("paint", *TASK_OF.values()):
        families = [one for one in FAMILIES if TASK_OF.get(one, "paint") == task]
        choices = ([f"[{','.join(names(one))}]"] if one in MULTI_SELECT else names(one) for one in families)
        for row in zip_longest(*choices):
            chosen = {one: choice for one, choice in zip(families, row, strict=True) if choice}
            cfg = config(f"task={task}", *(f"{one}={choice}" for one, choice in chosen.items()))
            for one, choice in chosen.items():
                nodes = cfg[one].items() if one in MULTI_SELECT else [(choice, cfg[one])]
                NODES.update({(one, key): value for key, value in nodes})
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
