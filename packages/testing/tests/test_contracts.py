"""Checks of contracts let those pass that keep them, and nobody else."""

from dataclasses import dataclass, replace

import pytest
import torch
from brushexp_testing import contract

import brushexp
from brushexp.errors import UserError
from brushexp.plugins.change.base import Change
from brushexp.plugins.order.base import Order
from brushexp.registry import FAMILIES


@dataclass(kw_only=True)
class Tied(Order):
    """All strokes lie at one depth, of which a number is missing."""

    every: int = 1

    def depth(self, strokes, accuracy):
        return torch.full((len(strokes) - 1,), 0.5)


def test_python_has_them_by_the_name_of_the_program_and_a_plugin_that_breaks_one_is_found():
    assert brushexp.testing.contract is contract
    assert {family for family in FAMILIES if not contract(family)} == {"color", "callbacks", "to"}
    (check,) = contract("order")
    with pytest.raises(AssertionError):
        check(Tied)


class Shrinks(Change):
    """Strokes shrink whenever they are asked for, and one more is lost at the end."""

    def limit(self, strokes, before, rows, state):
        return replace(strokes, width=strokes.width / 2)

    def end(self, strokes, front_to_back, state):
        return strokes[1:], front_to_back[1:]


def test_a_change_that_breaks_its_contract_is_found():
    broken = []
    for check in contract("change"):
        try:
            check(Shrinks)
        except (AssertionError, UserError):
            broken.append(check.__name__)
    assert broken == ["lets_strokes_stay_as_it_has_limited_them", "ends_with_at_least_its_strokes_in_one_order"]
