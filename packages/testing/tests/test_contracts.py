"""Test that the checks of plugin families report plugins that break the rules."""

from dataclasses import dataclass, replace

import pytest
import torch
from brushexp_testing import contract
from brushexp_testing.families import numbers_the_strokes_it_holds
from brushexp_testing.words import has_clear_message, has_clear_texts

import brushexp
from brushexp.errors import UserError
from brushexp.plugins.change.base import Change
from brushexp.plugins.order.base import Order
from brushexp.plugins.renderer.analytic import Analytic
from brushexp.registry import FAMILIES


@dataclass(kw_only=True)
class Tied(Order):
    """An order that breaks its contract: all depths are equal, and there is one depth too few."""

    every: int = 1

    def depth(self, strokes, accuracy):
        return torch.full((len(strokes) - 1,), 0.5)


def test_python_has_them_by_the_name_of_the_program_and_a_plugin_that_breaks_one_is_found():
    assert brushexp.testing.contract is contract
    assert {family for family in FAMILIES if len(contract(family)) == 1} == {"color", "callbacks", "to"}
    check, words = contract("order")
    words(Tied)
    with pytest.raises(AssertionError):
        check(Tied)


@pytest.mark.parametrize(
    ("docstring", "reason"),
    [
        ("Order by size", "full stop"),
        ("order by size.", "capital letter"),
        ("Which stroke is small lies on top.", "clause"),
        (f"Order {'and order ' * 12}by size.", "characters"),
        ("Order by size.\n\nArgs:\n    every: that pass between two orders.", "every: .*clause"),
        ("Order by size.\n\nArgs:\n    every: of the steps between two orders.", "every: .*noun"),
        ("Order by size.\n\nArgs:\n    every: how many steps pass between two orders.", "every: .*noun"),
        ("Order by size.\n\nArgs:\n    every: " + "a step, " * 60, "every: .*characters"),
    ],
)
def test_a_plugin_whose_words_are_not_plain_is_found(docstring, reason):
    untold = type("Untold", (Tied,), {"__doc__": docstring, "__module__": __name__})
    with pytest.raises(AssertionError, match=reason):
        has_clear_texts(untold)


def test_a_message_says_in_one_line_what_is_wrong_and_what_to_do():
    has_clear_message(UserError("size=0 is not 1 or more; try size=1"))
    for message in (
        "size=0 is wrong",
        "size=0 is not 1 or more; try size=1.",
        "no; " * 100 + "x",
    ):
        with pytest.raises(AssertionError):
            has_clear_message(UserError(message))


class HoldsByMask(Analytic):
    """Draw strokes and hold them all, but give a mask instead of their indices."""

    def held(self, strokes):
        return torch.ones(len(strokes), dtype=torch.bool)


def test_a_renderer_that_holds_strokes_by_a_mask_is_found():
    numbers_the_strokes_it_holds(Analytic)
    with pytest.raises(AssertionError):
        numbers_the_strokes_it_holds(HoldsByMask)


class Shrinks(Change):
    """Shrink strokes each time they are limited, and drop one stroke at the end."""

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
    assert broken == ["limits_strokes_once", "keeps_strokes_at_the_end"]
