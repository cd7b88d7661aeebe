"""What the program says when it cannot do what was asked."""


class UserError(ValueError):
    """A request that cannot be met: one line that says what is wrong, what would be right, and which key to type."""


def check_range(option: str, value: float | None, low: float, high: float) -> None:
    """Refuse a number beyond its limits, which belong to it; None is no number and passes.

    Args:
        option: what the user types, "to.process.fps" for instance.
        value: what was typed.
        low: the least that will do.
        high: the most.

    Raises:
        UserError: with the nearest value that would do.
    """
    if value is not None and not low <= value <= high:
        nearest = high if value > high else low
        raise UserError(f"{option}={value:g} is not within {low:g} to {high:g}; try {option}={nearest:g}")
