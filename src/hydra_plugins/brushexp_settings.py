"""A Hydra sweeper that checks every job and then runs all combinations of values or settings.

Every program that uses Hydra imports this file, so it imports other modules only when a sweep starts.
"""

import shlex
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Any

from hydra.core.config_search_path import ConfigSearchPath
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override
from hydra.core.plugins import Plugins
from hydra.plugins.search_path_plugin import SearchPathPlugin
from hydra.plugins.sweeper import Sweeper
from hydra.types import HydraContext, TaskFunction
from omegaconf import DictConfig, OmegaConf


@dataclass
class SettingsSweeperConf:
    """Options of ``hydra/sweeper=basic`` (see `offer_sweepers`): Hydra's two options and those of `SettingsSweeper`.

    ``pictures`` holds the values of ``pictures=``. A ``lenient`` sweep runs even if some jobs are invalid, and new
    jobs may be added when it is resumed.
    """

    _target_: str = "hydra_plugins.brushexp_settings.SettingsSweeper"
    _recursive_: bool = False  # otherwise Hydra would resolve ${x} in the name of a picture again
    max_batch_size: int | None = None
    params: dict[str, str] | None = None
    settings: list[str] = field(default_factory=lambda: [""])
    pictures: list[str] = field(default_factory=list)
    resume: bool = False
    lenient: bool = False


class SettingsSweeper(Sweeper):
    """Runs every combination of picture, setting and other swept values as one job.

    Each of the ``settings`` is a string of overrides such as ``"density=adaptive steps=200"``, or ``""``. Settings take
    precedence over the command line, which takes precedence over ``params``; ``image=`` on the command line replaces
    ``pictures``. If there is one job per picture, each job's subfolder is named after its picture.
    """

    config: DictConfig
    hydra_context: HydraContext

    def __init__(self, **options: Any) -> None:
        self.options = SettingsSweeperConf(**options)

    def setup(self, *, hydra_context: HydraContext, task_function: TaskFunction, config: DictConfig) -> None:
        self.hydra_context, self.config = hydra_context, config
        self.launcher = Plugins.instance().instantiate_launcher(
            hydra_context=hydra_context, task_function=task_function, config=config
        )

    def sweep(self, arguments: list[str]) -> None:
        """Check all jobs before writing anything, then launch them batch by batch."""
        from brushexp.runs.sweep_jobs import begin_sweep, check_jobs, launch_jobs, move_job  # noqa: PLC0415

        jobs = self.combine([*(f"{key}={value}" for key, value in (self.options.params or {}).items()), *arguments])
        places = check_jobs(self.hydra_context.config_loader, self.config, jobs, self.options.lenient)
        begin_sweep(self.config, jobs, self.options.resume, self.options.lenient)
        OmegaConf.save(self.config, Path(self.config.hydra.sweep.dir) / "multirun.yaml")
        assert self.launcher is not None
        if self.options.resume:
            jobs = [move_job(job, place) for job, place in zip(jobs, places, strict=True)]
        size = self.options.max_batch_size or len(jobs)
        for first in range(0, len(jobs), size):
            launch_jobs(self.launcher.launch, self.config, jobs[first : first + size], first, self.options.resume)

    def combine(self, arguments: Sequence[str]) -> list[list[str]]:
        """Return the overrides of every job."""
        from brushexp.cli.many_pictures import all_pictures, subfolders_for  # noqa: PLC0415
        from brushexp.config.changes import expand_changes, keep_added, merge  # noqa: PLC0415
        from brushexp.config.compose import folders_in  # noqa: PLC0415
        from brushexp.config.words import expand_shorthand, verbatim  # noqa: PLC0415
        from brushexp.runs.sweep_jobs import SUBFOLDER  # noqa: PLC0415

        parser = OverridesParser.create(config_loader=self.hydra_context.config_loader)
        overrides = parser.parse_overrides([*arguments])
        typed = any(override.get_key_element() == "image" for override in overrides)
        pictures = [] if typed else all_pictures(self.options.pictures, folders_in(self.config))
        settings = [shlex.split(setting) for setting in self.options.settings]
        jobs: list[list[str]] = []
        for words in settings:  # so that an interrupted sweep has all pictures of some settings
            for picture in [[f"image={one}"] for one in pictures] or [[]]:
                meant = expand_changes([*picture, *words], beside=arguments, sweep=True)
                own = [expand_shorthand(word, sweep=True) for word in keep_added(meant, arguments)]
                jobs += map(merge, combinations_of([*overrides, *parser.parse_overrides(own)]))
        if pictures and len(jobs) == len(pictures):
            places = map(verbatim, subfolders_for(pictures))
            jobs = [[*job, SUBFOLDER + place] for job, place in zip(jobs, places, strict=True)]
        return jobs


def combinations_of(overrides: Sequence[Override]) -> list[list[str]]:
    """Return all combinations of the values in overrides; if a key is repeated, its last override counts."""
    from brushexp.errors import UserError  # noqa: PLC0415

    choices: dict[str, list[str]] = {}
    for override in overrides:
        key = override.get_key_element()
        if not override.is_sweep_override():
            values = [override.get_value_element_as_str()]
        elif override.is_discrete_sweep():
            values = list(override.sweep_string_iterator())
        else:
            raise UserError(f"{override.input_line} is not a list of values; try hydra/sweeper=optuna objective=psnr")
        choices[key] = [f"{key}={value}" for value in values]
    return [list(job) for job in product(*choices.values())]


class RegistryFirst(SearchPathPlugin):
    """Makes Hydra search registered configs before files, so that loss presets can be registered by name."""

    def manipulate_search_path(self, search_path: ConfigSearchPath) -> None:
        search_path.prepend("schema", "structured://")
