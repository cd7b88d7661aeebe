"""Assertions that a call raises a UserError whose message is one line."""

import re
from collections.abc import Callable

import pytest

from brushexp.errors import UserError


def refusal(function: Callable[..., object], *arguments: object, **options: object) -> str:
    """Assert that a call raises a UserError with a one-line message, and return the message."""
    with pytest.raises(UserError) as caught:
        function(*arguments, **options)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def refuses(match: str, function: Callable[..., object], *arguments: object, **options: object) -> None:
    """Assert that a call raises a UserError with a one-line message that matches a pattern."""
    line = refusal(function, *arguments, **options)
    assert re.search(match, line), line
