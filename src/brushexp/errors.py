"""Define the error whose message tells a user what to type instead."""


class UserError(ValueError):
    """A request that cannot be met: one line that says what is wrong, what would be right, and which key to type."""
