"""Hydra sweeper ``optuna``: search for settings with hydra-optuna-sweeper, in the direction that the objective needs.

It replaces the original sweeper of this name. Unlike the original, it can continue studies, and does not minimise PSNR
by default.
"""

import logging
from dataclasses import dataclass, field
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override
from hydra.plugins.sweeper import Sweeper
from hydra.types import HydraContext, TaskFunction
from omegaconf import MISSING, DictConfig

DIRECTIONS = {"higher": "maximize", "lower": "minimize"}  # better values of a metric -> Optuna's direction


@dataclass
class StudySweeperConf:
    """Options of ``hydra/sweeper=optuna`` (see `offer_sweepers`): the original sweeper's options, and ``resume``."""

    _target_: str = "hydra_plugins.brushexp_optuna.StudySweeper"
    defaults: list[Any] = field(default_factory=lambda: [{"sampler": "tpe"}])
    sampler: Any = MISSING
    direction: Any = None
    storage: Any = None
    study_name: str = "study"
    n_trials: int = 20
    n_jobs: int = 1
    max_failure_rate: float = 1.0
    params: dict[str, str] | None = None
    custom_search_space: str | None = None
    resume: bool = False


def sweeper_config() -> type[StudySweeperConf] | None:
    """Return the sweeper's config if hydra-optuna-sweeper is installed, otherwise None."""
    if not find_spec("hydra_plugins.hydra_optuna_sweeper"):
        return None
    logging.getLogger("alembic").setLevel(logging.WARNING)  # Optuna imports it, and it logs each part that it loads
    return StudySweeperConf


class StudySweeper(Sweeper):
    """Sweeper that runs Optuna's trials as jobs; a failed trial is recorded as failed, and the study continues."""

    config: Any  # Hydra's config, set by `setup`

    def __init__(self, resume: bool, direction: str | None, **options: Any) -> None:
        self.resume, self.direction, self.options = resume, direction, options

    def setup(self, *, hydra_context: HydraContext, task_function: TaskFunction, config: DictConfig) -> None:
        from brushexp.contracts import UserError  # noqa: PLC0415

        if self.options["storage"] and int(version("sqlalchemy").partition(".")[0]) > 1:
            cure = "type: pip install 'sqlalchemy<2' 'alembic<1.14', or leave it out: the sweep's folder has all trials"
            raise UserError(f"hydra.sweeper.storage={self.options['storage']} needs SQLAlchemy 1; {cure}")
        from hydra_plugins.hydra_optuna_sweeper import _impl  # noqa: PLC0415  (private; tried with 1.3.0)

        self.config, self.loader = config, hydra_context.config_loader
        self.direction = better_direction(config.objective, self.direction)
        self.space_of = _impl.create_params_from_overrides
        self.study = _impl.OptunaSweeperImpl(search_space=None, direction=self.direction, **self.options)
        self.study.setup(hydra_context=hydra_context, task_function=task_function, config=config)

    def sweep(self, arguments: list[str]) -> None:
        """Check jobs at the ends of the search space, then run the remaining trials."""
        from brushexp.contracts import UserError  # noqa: PLC0415
        from brushexp.contracts.runs import (  # noqa: PLC0415
            begin_sweep,
            check_jobs,
            renew_sweep_report,
        )

        words = [*(f"{key}={value}" for key, value in (self.options["params"] or {}).items()), *arguments]
        overrides = OverridesParser.create(config_loader=self.loader).parse_overrides(words)
        check_jobs(self.loader, self.config, corner_jobs({one.get_key_element(): ends_of(one) for one in overrides}))
        begin_sweep(self.config, [words], self.resume)
        if self.resume:
            self.go_on(words)
        folder = Path(self.config.hydra.sweep.dir)
        try:
            self.study.sweep(arguments)
        except ValueError as error:
            if "No trials are completed" not in str(error):
                raise
            raise UserError(f"all trials of the study failed; {folder / 'table.md'} says why") from error
        finally:
            renew_sweep_report(folder)

    def go_on(self, words: list[str]) -> None:
        """Add the finished trials in the sweep's folder to the study, and queue killed trials to be rerun first."""
        import optuna  # noqa: PLC0415

        from brushexp.contracts.results import has_ended, read_result, words_of  # noqa: PLC0415

        space, study = self.space_of(words)[0], self.open_study()
        recorded = [trial.params for trial in study.trials if trial.state.is_finished()]
        folders = [path for path in Path(self.config.hydra.sweep.dir).iterdir() if path.name.isdecimal()]
        killed: list[dict[str, Any]] = []
        ended: list[dict[str, Any]] = []
        for folder in sorted(folders, key=lambda path: int(path.name)):
            typed = dict(word.split("=", 1) for word in words_of(folder) if "=" in word)
            values = {key: value_in(one, typed[key]) for key, one in space.items() if key in typed}
            (ended if has_ended(folder) else killed).append(values)
            if has_ended(folder) and values not in recorded:
                study.add_trial(frozen_trial(read_result(folder), values, space, self.config.objective))
        for k, values in enumerate(killed):
            if values not in (*ended, *killed[:k]):  # not yet repeated by an earlier resume
                study.enqueue_trial(values)
        self.study.n_trials -= sum(trial.state.is_finished() for trial in study.trials)
        self.study.job_idx = 1 + max((int(path.name) for path in folders), default=-1)
        if isinstance(self.study.sampler, optuna.samplers.BaseSampler):
            self.study.sampler.reseed_rng()  # otherwise it would repeat its first proposals

    def open_study(self) -> Any:
        """Create or load the Optuna study, and mark as failed all trials that the database still lists as running."""
        import optuna  # noqa: PLC0415

        name = self.study.study_name = self.options["study_name"]
        storage = self.study.storage = self.options["storage"] or optuna.storages.InMemoryStorage()
        study = optuna.create_study(storage=storage, study_name=name, direction=self.direction, load_if_exists=True)
        for trial in study.trials:
            if trial.state is optuna.trial.TrialState.RUNNING:
                study.tell(trial.number, state=optuna.trial.TrialState.FAIL)
                self.study.n_trials += 1
        return study


def better_direction(objective: str | None, typed: str | None) -> str:
    """Return ``maximize`` or ``minimize``: the metric's direction or, for unknown metrics, the value in ``typed``."""
    from brushexp.contracts import UserError  # noqa: PLC0415
    from brushexp.contracts.results import quantities  # noqa: PLC0415

    option, choices = "hydra.sweeper.direction", tuple(DIRECTIONS.values())
    if objective is None:
        raise UserError("Optuna needs objective=, the value of metrics.json to improve; try objective=psnr")
    if typed is not None and typed not in choices:
        raise UserError(f"{option}={typed} is not one of {', '.join(choices)}; drop it")
    metric = quantities().get(objective)
    own = DIRECTIONS.get(metric.better) if metric else None
    if own and typed not in (None, own):
        raise UserError(f"{option}={typed} searches for the worst {objective}; drop it")
    if not (own or typed):
        names = ", ".join(name for name, metric in quantities().items() if metric.better)
        raise UserError(f"{objective} has no known direction; add {option}=minimize or maximize (known: {names})")
    return own or str(typed)


def frozen_trial(result: dict[str, Any], values: dict[str, Any], space: dict[str, Any], objective: str) -> Any:
    """Convert a finished trial to an Optuna trial."""
    import optuna  # noqa: PLC0415

    from brushexp.contracts.results import objective_in  # noqa: PLC0415
    from brushexp.contracts.runs import Status  # noqa: PLC0415

    failed, states = result["status"] == Status.FAILED, optuna.trial.TrialState
    state, value = (states.FAIL, None) if failed else (states.COMPLETE, objective_in(result, objective))
    return optuna.trial.create_trial(state=state, value=value, params=values, distributions=space)


def value_in(space: Any, typed: str) -> Any:
    """Convert a job's argument back to the value that Optuna proposed."""
    if hasattr(space, "choices"):
        return next(choice for choice in space.choices if str(choice) == typed)
    return int(typed) if type(space).__name__.startswith("Int") else float(typed)


def ends_of(override: Override) -> list[str]:
    """Return an override's values: all values of a choice, or the first and last values of a range or interval."""
    if not override.is_sweep_override():
        return [override.get_value_element_as_str()]
    sweep: Any = override.value()
    if override.is_interval_sweep():
        return [str(sweep.start), str(sweep.end)]
    if override.is_range_sweep():
        return [str(sweep.start), str(sweep.stop)]  # Optuna includes the end
    return list(override.sweep_string_iterator())


def corner_jobs(ends: dict[str, list[str]]) -> list[list[str]]:
    """List jobs that together try every value of every key, each combined with the first values of all other keys."""
    first = {key: values[0] for key, values in ends.items()}
    jobs = [first] + [first | {key: value} for key, values in ends.items() for value in values[1:]]
    return [[f"{key}={value}" for key, value in job.items()] for job in jobs]
