"""Tests that every registered plugin and preset, including your own, fulfils the contract of its family."""

import pytest
from brushexp_testing import contract
from omegaconf import OmegaConf
from typed import members, nodes

from brushexp.registry import FAMILIES, build, plugins


@pytest.mark.parametrize("plugin", plugins(), ids=lambda plugin: f"{plugin.family}={plugin.name}")
def test_every_plugin_says_in_one_line_what_it_is(plugin):
    assert 10 <= len(plugin.summary) <= 200
    assert plugin.summary.rstrip(".:;") != plugin.cls.__name__


@pytest.mark.parametrize("family", FAMILIES)
def test_the_options_of_every_choice_are_typed(family):
    for name in members(family):
        assert "_target_" in nodes()[family, name]


CASES = [(family, name, check) for family in FAMILIES for name in members(family) for check in contract(family)]


@pytest.mark.parametrize(("family", "name", "check"), CASES, ids=[f"{f}={n}-{c.__name__}" for f, n, c in CASES])
def test_a_plugin_keeps_the_contract_of_its_family(family, name, check, monkeypatch):
    monkeypatch.setenv("WANDB_MODE", "offline")

    def make(**options):
        return build(OmegaConf.merge(nodes()[family, name], options))

    check(make)
