"""Checks of contracts let those pass that keep them, and nobody else."""

from dataclasses import dataclass

import pytest
import torch
from brushexp_testing import contract

import brushexp
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
