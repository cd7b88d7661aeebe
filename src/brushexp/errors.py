"""Define the error that tells users how to correct a request, and shorten other errors to one line."""


class UserError(ValueError):
    """Raised for a request that cannot be met; its message says in one line what is wrong and what to type instead."""

    def __init__(self, message: object) -> None:
        super().__init__(on_a_line(str(message)))


def on_a_line(text: str, besides: str = "") -> str:
    r"""Escape control characters other than ``besides``, because file names may contain line breaks or terminal codes.

    >>> print(on_a_line("a\x1b[31m\n.png"), on_a_line("é ☃"))
    a\x1b[31m\n.png é ☃
    """
    return "".join(one if one.isprintable() or one in besides else repr(one)[1:-1] for one in text)


def first_line(error: BaseException) -> str:
    """Return the first line of an error message, preceded by the error's type unless it is a `UserError`."""
    text = str(error).strip().partition("\n")[0]
    kind = type(error).__name__
    return text if isinstance(error, UserError) else f"{kind}: {text}" if text else kind
