"""The one number by which a search over settings judges a run: which it is, and which way it is better."""

from collections.abc import Mapping
from typing import Any

from brushexp.errors import UserError
from brushexp.results.quantities import quantities

DIRECTIONS = {"higher": "maximize", "lower": "minimize"}  # as Optuna calls them


def objective_in(result: Mapping[str, Any], name: str) -> float:
    """The number of a run's metrics.json that has this name; a UserError names those that there are."""
    numbers = {key: float(value) for key, value in result.items() if type(value) in (int, float)}
    if name not in numbers:
        raise UserError(f"objective={name} is no number of this run; choose one of {', '.join(numbers)}")
    return numbers[name]


def better_direction(objective: str | None, typed: str | None) -> str:
    """``maximize`` or ``minimize``: as the tables know it, or as ``typed`` for what they do not know.

    A UserError without an objective, with a direction that is not its own, or if nobody says which it is.
    """
    option, choices = "hydra.sweeper.direction", tuple(DIRECTIONS.values())
    if objective is None:
        raise UserError("Optuna needs objective=: the number of metrics.json that it improves; try objective=psnr")
    if typed is not None and typed not in choices:
        raise UserError(f"{option}={typed} is not one of {', '.join(choices)}; drop it")
    metric = quantities().get(objective)
    known = DIRECTIONS.get(metric.better) if metric else None
    if known and typed not in (None, known):
        raise UserError(f"{option}={typed} looks for the worst {objective}; drop it")
    if not (known or typed):
        names = ", ".join(name for name, metric in quantities().items() if metric.better)
        raise UserError(f"nobody knows which {objective} is better; add {option}=minimize or maximize (known: {names})")
    return known or str(typed)
