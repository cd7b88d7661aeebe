"""Hydra sweeper: all combinations of values, or of a list of settings; every job is checked before the first starts.

It is here and not in brushexp because Hydra takes sweepers from the namespace package ``hydra_plugins`` alone.
"""

import shlex
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from hydra._internal.core_plugins.basic_sweeper import BasicSweeper, BasicSweeperConf
from hydra.core.config_search_path import ConfigSearchPath
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override
from hydra.core.utils import JobReturn
from hydra.plugins.search_path_plugin import SearchPathPlugin


@dataclass
class SettingsSweeperConf(BasicSweeperConf):
    """Options of ``hydra/sweeper=basic`` (`offer_sweepers`): Hydra's, ``settings``, and ``resume`` to go on.

    ``pictures`` are what ``pictures=`` takes. A ``lenient`` sweep, where they were typed, runs though some jobs are
    refused, and may have more ones later.
    """

    _target_: str = "hydra_plugins.brushexp_settings.SettingsSweeper"
    settings: list[str] = field(default_factory=lambda: [""])
    pictures: list[str] = field(default_factory=list)
    resume: bool = False
    lenient: bool = False


class SettingsSweeper(BasicSweeper):
    """One job for every picture and setting, times all combinations of what else is swept.

    ``settings`` are overrides as the command line has them, such as ``"density=adaptive steps=200"``; ``""`` is none.
    They stand above those of the command line, which says what all settings have in common. ``params`` stand below it,
    and so do ``pictures`` below an ``image=`` that was typed. A job has the subfolder of its picture's name, if it is
    the only one of this picture.
    """

    def __init__(
        self,
        max_batch_size: int | None,
        params: dict[str, str] | None,
        settings: list[str],
        pictures: list[str],
        resume: bool,
        lenient: bool,
    ) -> None:
        super().__init__(max_batch_size, params)
        self.settings, self.pictures, self.resume, self.lenient = settings, pictures, resume, lenient

    def setup(self, **options: Any) -> None:
        """As in Hydra; jobs that a sweep has when it goes on are left out, and failed ones are told in one line."""
        super().setup(**options)
        assert self.launcher is not None
        launch = self.launcher.launch

        def launch_all(batch: Sequence[Sequence[str]], initial_job_idx: int) -> Sequence[JobReturn]:
            from brushexp.runs.sweep_jobs import launch_left  # noqa: PLC0415

            assert self.config is not None
            return launch_left(launch, self.config, batch, initial_job_idx, self.resume)

        self.launcher.launch = launch_all  # type: ignore[method-assign, assignment]

    def split_arguments(  # type: ignore[override]  # a static method there
        self, overrides: list[Override], max_batch_size: int | None
    ) -> list[list[list[str]]]:
        """The overrides of every job, in batches, each checked before anything of the sweep is written."""
        from brushexp.cli.many_pictures import all_pictures, subfolders_for  # noqa: PLC0415
        from brushexp.config.compose import folders_in  # noqa: PLC0415
        from brushexp.config.words import expand_shorthand, verbatim  # noqa: PLC0415  (Hydra imports this file for any program)
        from brushexp.runs.run_folder import SUBFOLDER  # noqa: PLC0415
        from brushexp.runs.sweep_jobs import begin_sweep, check_jobs  # noqa: PLC0415

        assert self.hydra_context is not None
        assert self.config is not None
        loader = self.hydra_context.config_loader
        parser = OverridesParser.create(config_loader=loader)

        def combined(words: Sequence[str]) -> list[list[str]]:
            own = parser.parse_overrides([expand_shorthand(word, sweep=True) for word in words])
            return [list(job) for job in BasicSweeper.split_arguments([*overrides, *own], None)[0]]

        typed = any(override.get_key_element() == "image" for override in overrides)
        pictures = [] if typed else all_pictures(self.pictures, folders_in(self.config))
        settings = [shlex.split(setting) for setting in self.settings]
        jobs = [
            job
            for words in settings  # of a sweep that is stopped, some settings then have all pictures
            for picture in [[f"image={one}"] for one in pictures] or [[]]
            for job in combined([*picture, *words])
        ]
        if pictures and len(jobs) == len(pictures):
            places = map(verbatim, subfolders_for(pictures))
            jobs = [[*job, SUBFOLDER + place] for job, place in zip(jobs, places, strict=True)]
        check_jobs(loader, self.config, jobs, self.lenient)
        begin_sweep(self.config, jobs, self.resume, self.lenient)
        return [list(batch) for batch in self.split_overrides_to_chunks(jobs, max_batch_size)]

    def validate_batch_is_legal(self, batch: Sequence[Sequence[str]]) -> None:
        """Nothing: all jobs have been composed already."""


class RegistryFirst(SearchPathPlugin):
    """Registered configs come before files, so that a preset of a loss can be registered below its own name."""

    def manipulate_search_path(self, search_path: ConfigSearchPath) -> None:
        search_path.prepend("schema", "structured://")
