"""Define the error whose message tells a user what to type instead, and shorten others to a line."""


class UserError(ValueError):
    """A request that cannot be met: one line that says what is wrong, what would be right, and which key to type."""

    def __init__(self, message: object) -> None:
        super().__init__(on_a_line(str(message)))


def on_a_line(text: str, besides: str = "") -> str:
    r"""Escape what is no letter, ``besides`` those: names of files may break a line, or command a terminal.

    >>> print(on_a_line("a\x1b[31m\n.png"), on_a_line("é ☃"))
    a\x1b[31m\n.png é ☃
    """
    return "".join(one if one.isprintable() or one in besides else repr(one)[1:-1] for one in text)


def first_line(error: BaseException) -> str:
    """Return the first line of an error, with its kind unless it is a message to the user."""
    text = str(error).strip().partition("\n")[0]
    kind = type(error).__name__
    return text if isinstance(error, UserError) else f"{kind}: {text}" if text else kind
