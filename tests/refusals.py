"""What a user can mend is refused in one line, which says what to type."""

import re
from collections.abc import Callable

import pytest

from brushexp.errors import UserError


def refusal(function: Callable[..., object], *arguments: object, **options: object) -> str:
    """The line with which a call is refused."""
    with pytest.raises(UserError) as caught:
        function(*arguments, **options)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def refuses(match: str, function: Callable[..., object], *arguments: object, **options: object) -> None:
    """Assert that a call is refused in a line that matches."""
    line = refusal(function, *arguments, **options)
    assert re.search(match, line), line
