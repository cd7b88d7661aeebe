"""Define the error whose message tells a user what to type instead, and shorten others to a line."""


class UserError(ValueError):
    """A request that cannot be met: one line that says what is wrong, what would be right, and which key to type."""


def first_line(error: BaseException) -> str:
    """Return the first line of an error, with its kind unless it is a message to the user."""
    text = str(error).strip().partition("\n")[0]
    kind = type(error).__name__
    return text if isinstance(error, UserError) else f"{kind}: {text}" if text else kind
