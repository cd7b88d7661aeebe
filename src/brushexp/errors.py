"""What the program says when it cannot do what was asked."""


class UserError(ValueError):
    """A request that cannot be met: one line that says what is wrong, what would be right, and which key to type."""
