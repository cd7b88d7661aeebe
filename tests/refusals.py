"""Assertions that calls are refused with a line that says how to fix them."""

import re
from collections.abc import Callable

import pytest

from brushexp.errors import UserError


def refusal(function: Callable[..., object], *arguments: object, **options: object) -> str:
    """Return the line with which a call is refused."""
    with pytest.raises(UserError) as caught:
        function(*arguments, **options)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def refuses(match: str, function: Callable[..., object], *arguments: object, **options: object) -> None:
    """Assert that a call is refused with a line that matches."""
    line = refusal(function, *arguments, **options)
    assert re.search(match, line), line
