"""Hydra sweeper ``optuna``: hydra-optuna-sweeper, told by the objective which way is better; its studies go on.

It takes the place of the original under its name, because that would minimise a PSNR without a word.
"""

from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override
from hydra.plugins.sweeper import Sweeper
from hydra.types import HydraContext, TaskFunction
from omegaconf import MISSING, DictConfig

DIRECTIONS = {"higher": "maximize", "lower": "minimize"}  # as Optuna calls them


@dataclass
class StudySweeperConf:
    """Options of ``hydra/sweeper=optuna`` (`offer_sweepers`): the original's, and ``resume`` to go on."""

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


class StudySweeper(Sweeper):
    """Optuna's trials as jobs; a failed one is marked, and the study goes on."""

    config: Any  # of Hydra, from `setup` on

    def __init__(self, resume: bool, direction: str | None, **options: Any) -> None:
        self.resume, self.direction, self.options = resume, direction, options

    def setup(self, *, hydra_context: HydraContext, task_function: TaskFunction, config: DictConfig) -> None:
        """As in Hydra; a UserError if the objective and the direction do not agree."""
        from brushexp.compat.optuna import make_sweeper  # noqa: PLC0415
        from brushexp.errors import UserError  # noqa: PLC0415

        if self.options["storage"] and int(version("sqlalchemy").partition(".")[0]) > 1:
            cure = "type: pip install 'sqlalchemy<2' 'alembic<1.14', or leave it out: the sweep's folder has all trials"
            raise UserError(f"hydra.sweeper.storage={self.options['storage']} needs SQLAlchemy 1; {cure}")
        self.config, self.loader = config, hydra_context.config_loader
        self.direction = better_direction(config.objective, self.direction)
        self.study = make_sweeper(direction=self.direction, **self.options)
        self.study.setup(hydra_context=hydra_context, task_function=task_function, config=config)

    def sweep(self, arguments: list[str]) -> None:
        """Check the ends of the search space, then run the trials that are left."""
        from brushexp.errors import UserError  # noqa: PLC0415
        from brushexp.runs.sweep_jobs import begin_sweep, check_jobs  # noqa: PLC0415
        from brushexp.runs.sweep_report import renew  # noqa: PLC0415

        words = [f"{key}={value}" for key, value in (self.options["params"] or {}).items()]
        overrides = OverridesParser.create(config_loader=self.loader).parse_overrides([*words, *arguments])
        check_jobs(self.loader, self.config, extremes({one.get_key_element(): ends_of(one) for one in overrides}))
        begin_sweep(self.config, [[*words, *arguments]], self.resume)
        if self.resume:
            self.go_on([*words, *arguments])
        folder = Path(self.config.hydra.sweep.dir)
        try:
            self.study.sweep(arguments)
        except ValueError as error:
            if "No trials are completed" not in str(error):
                raise
            raise UserError(f"all trials of the study failed; {folder / 'table.md'} says why") from error
        finally:
            renew(folder)

    def go_on(self, words: list[str]) -> None:
        """Tell Optuna of the trials in the folder of the sweep; trials that were killed are tried first, anew."""
        import optuna  # noqa: PLC0415

        from brushexp.compat.optuna import search_space  # noqa: PLC0415
        from brushexp.results.runs import has_ended, read_result, words_of  # noqa: PLC0415

        space, study = search_space(words), self.open_study()
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
            if values not in (*ended, *killed[:k]):  # else an earlier resume has tried them
                study.enqueue_trial(values)
        self.study.n_trials -= sum(trial.state.is_finished() for trial in study.trials)
        self.study.job_idx = 1 + max((int(path.name) for path in folders), default=-1)
        if isinstance(self.study.sampler, optuna.samplers.BaseSampler):
            self.study.sampler.reseed_rng()  # or it would begin as it has begun before

    def open_study(self) -> Any:
        """The study of Optuna; a database has it already, and takes trials that were killed for being at work."""
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
    """``maximize`` or ``minimize``: as the tables know it, or as ``typed`` for a metric that they do not know.

    A UserError without an objective, with a direction that is not its own, or if neither says which it is.
    """
    from brushexp.errors import UserError  # noqa: PLC0415
    from brushexp.results.quantities import quantities  # noqa: PLC0415

    option, choices = "hydra.sweeper.direction", tuple(DIRECTIONS.values())
    if objective is None:
        raise UserError("Optuna needs objective=: the number of metrics.json that it improves; try objective=psnr")
    if typed is not None and typed not in choices:
        raise UserError(f"{option}={typed} is not one of {', '.join(choices)}; drop it")
    metric = quantities().get(objective)
    own = DIRECTIONS.get(metric.better) if metric else None
    if own and typed not in (None, own):
        raise UserError(f"{option}={typed} looks for the worst {objective}; drop it")
    if not (own or typed):
        names = ", ".join(name for name, metric in quantities().items() if metric.better)
        raise UserError(f"nobody knows which {objective} is better; add {option}=minimize or maximize (known: {names})")
    return own or str(typed)


def frozen_trial(result: dict[str, Any], values: dict[str, Any], space: dict[str, Any], objective: str) -> Any:
    """A trial that has ended, as Optuna records it."""
    import optuna  # noqa: PLC0415

    from brushexp.results.runs import objective_in  # noqa: PLC0415

    if result["status"] == "failed":
        state, value = optuna.trial.TrialState.FAIL, None
    else:
        state, value = optuna.trial.TrialState.COMPLETE, objective_in(result, objective)
    return optuna.trial.create_trial(state=state, value=value, params=values, distributions=space)


def value_in(space: Any, typed: str) -> Any:
    """The value of a parameter, by the word of a job, as Optuna had it."""
    if hasattr(space, "choices"):
        return next(choice for choice in space.choices if str(choice) == typed)
    return int(typed) if type(space).__name__.startswith("Int") else float(typed)


def ends_of(override: Override) -> list[str]:
    """The values of an override: all of a choice, the first and last of a range or interval."""
    if not override.is_sweep_override():
        return [override.get_value_element_as_str()]
    sweep: Any = override.value()
    if override.is_interval_sweep():
        return [str(sweep.start), str(sweep.end)]
    if override.is_range_sweep():
        return [str(sweep.start), str(sweep.stop)]  # which Optuna counts in
    return list(override.sweep_string_iterator())


def extremes(ends: dict[str, list[str]]) -> list[list[str]]:
    """Jobs in which each value of each key is there once, with the first values of the others."""
    first = {key: values[0] for key, values in ends.items()}
    jobs = [first] + [first | {key: value} for key, values in ends.items() for value in values[1:]]
    return [[f"{key}={value}" for key, value in job.items()] for job in jobs]
