"""Private parts of Hydra's Optuna sweeper that brushexp uses; tried with hydra-optuna-sweeper 1.3.0."""

from typing import Any


def make_sweeper(**options: Any) -> Any:
    """Make the object behind Hydra's sweeper, whose study and trials can be changed before it begins."""
    from hydra_plugins.hydra_optuna_sweeper._impl import OptunaSweeperImpl  # noqa: PLC0415  (optuna is slow to load)

    return OptunaSweeperImpl(search_space=None, **options)


def search_space(words: list[str]) -> dict[str, Any]:
    """Return the distribution of each key that a study varies."""
    from hydra_plugins.hydra_optuna_sweeper._impl import create_params_from_overrides  # noqa: PLC0415

    space: dict[str, Any] = create_params_from_overrides(words)[0]
    return space
