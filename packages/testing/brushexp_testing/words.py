"""Check that the texts of plugins, such as summaries, help and messages, are plain, short and complete."""

import inspect
import re
from collections.abc import Callable
from typing import Any

from brushexp.contracts import UserError

LONGEST_SUMMARY = 120  # characters
LONGEST_HELP = 360  # characters
LONGEST_MESSAGE = 320  # characters
LIBRARIES = ("abc", "builtins", "collections", "lightning", "torch", "typing")  # libraries whose classes members extend
CLAUSE = re.compile(  # at the start
    r"((by|from|in|of|on|over|to|with) )?(how|that|what|where|which|who|whose) |of ", re.IGNORECASE
)
OPTION = re.compile(r"^ {4}(\w+): (.*(?:\n {5,}.*)*)", re.MULTILINE)


def problem_of_summary(text: str) -> str:
    """Describe what is wrong with the first line of a docstring; "" if nothing is wrong."""
    if not text.endswith((".", ":")):
        return "it is not a sentence that ends in a full stop"
    if len(text) > LONGEST_SUMMARY:
        return f"it has {len(text)} characters, more than {LONGEST_SUMMARY}"
    if not re.match(r"[A-Z0-9`]", text):
        return "it does not begin with a capital letter"
    return "it begins with a clause instead of its noun or verb" if CLAUSE.match(text) else ""


def problem_of_help(text: str) -> str:
    """Describe what is wrong with the help of an option; "" if nothing is wrong."""
    if len(text) > LONGEST_HELP:
        return f"it has {len(text)} characters, more than {LONGEST_HELP}"
    if not re.match(r"[A-Za-z0-9`'\"(]", text):
        return "it does not begin with a word or a number"
    return 'it begins with a clause or "of" instead of its noun' if CLAUSE.match(text) else ""


def problem_of_message(text: str) -> str:
    """Describe what is wrong with a message to users; "" if nothing is wrong."""
    if len(text) > LONGEST_MESSAGE:
        return f"it has {len(text)} characters, more than {LONGEST_MESSAGE}"
    if "\n" in text or text.endswith((".", ";", ":", ",")):
        return "it is not one line, or ends in a full stop, semicolon, colon or comma"
    return "it does not say what to do, after a semicolon" if ";" not in text else ""


def options_of_docstring(docstring: str) -> dict[str, str]:
    """Map the options listed under ``Args:`` in a docstring to their help.

    >>> options_of_docstring(\"\"\"Blur.
    ...
    ... Args:
    ...     size: width in pixels,
    ...         at least 1.
    ... \"\"\")
    {'size': 'width in pixels, at least 1.'}
    """
    _, _, arguments = inspect.cleandoc(docstring).partition("Args:\n")
    return {match[1]: " ".join(match[2].split()) for match in OPTION.finditer(arguments)}


def speaks_plainly(make: Callable[..., Any]) -> None:
    """Check that a plugin's summary and the help of its options are plain, short and complete."""
    for cls in type(make()).__mro__:
        written = cls.__doc__ or ""
        is_generated = written.startswith(f"{cls.__name__}(")  # by a dataclass
        if not written or is_generated or cls.__module__.partition(".")[0] in LIBRARIES:
            continue
        summary = inspect.cleandoc(written).partition("\n")[0]
        assert not (wrong := problem_of_summary(summary)), f"{cls.__name__}: {summary!r}: {wrong}"
        for option, text in options_of_docstring(written).items():
            assert not (wrong := problem_of_help(text)), f"{cls.__name__}, {option}: {text!r}: {wrong}"


def refuses_plainly(error: UserError) -> None:
    """Check that a message to users is one short line that says what is wrong and what to do."""
    assert not (wrong := problem_of_message(str(error))), f"{str(error)!r}: {wrong}"
