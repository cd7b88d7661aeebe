"""Curves, pictures, numbers and the catalogue for Weights & Biases."""

from __future__ import annotations

import io
import logging
import netrc
import os
from collections.abc import Iterator
from contextlib import contextmanager
from enum import Enum
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from PIL import Image

from brushexp.errors import UserError
from brushexp.plugins.logger.base import Logger, Run
from brushexp.registry import register

if TYPE_CHECKING:
    from lightning.pytorch.loggers import Logger as LightningLogger

log = logging.getLogger(__name__)
STEP = "trainer/global_step"  # what Lightning's WandbLogger calls the step of a curve
EXIT_CODES = {"completed": 0, "interrupted": 130}
FAILED = 1
HABITS = {  # of wandb, unless the user says otherwise
    "WANDB_SILENT": "true",
    "WANDB_CONSOLE": "off",  # it would keep all that the program prints
    "WANDB_ERROR_REPORTING": "false",
    "WANDB_INIT_TIMEOUT": "15",  # seconds that a slow network may hold up the beginning
    "WANDB_FINISH_TIMEOUT": "60",  # and the end; what is not sent then is kept
}
ONE_SERVICE = ("api.wandb.ai", "api.forge.coreweave.com")  # the same accounts under two names


class Mode(Enum):
    """Where the data of a run go."""

    auto = "auto"
    online = "online"
    offline = "offline"
    disabled = "disabled"


@register("logger", "wandb")
class WeightsAndBiases(Logger):
    """Curves, pictures, table and catalogue for Weights & Biases; without network unless you are logged in there.

    Everything is kept in the folder ``wandb`` of the run. What was painted offline can be sent later with ``wandb
    sync``. Reports of errors in wandb itself are not sent to its makers, unless WANDB_ERROR_REPORTING says so.

    Args:
        project: where the runs are shown.
        entity: user or team that the project belongs to; None for the account's own.
        mode: auto: online if somebody is logged in (WANDB_API_KEY or ``wandb login``), offline if nobody is, unless
            WANDB_MODE says otherwise; disabled: nothing is kept.
        group: shows runs together; None for the folder's name of the sweep.
        tags: to find runs by.
    """

    def __init__(
        self,
        *,
        project: str = "brushexp",
        entity: str | None = None,
        mode: Mode = Mode.auto,
        group: str | None = None,
        tags: list[str] = [],  # noqa: B006
    ) -> None:
        for key, value in HABITS.items():
            os.environ.setdefault(key, value)
        if mode is Mode.online and not is_logged_in():
            raise UserError(
                "logger.wandb.mode=online, but nobody is logged in to wandb; run wandb login, or choose "
                "logger.wandb.mode=offline"
            )
        self.mode = mode
        self.options: dict[str, Any] = {"project": project, "entity": entity, "tags": tags or None}
        self.group = group
        self._run: Any = None

    def open(self, run: Run) -> LightningLogger:
        import wandb  # noqa: PLC0415
        from lightning.pytorch.loggers import WandbLogger  # noqa: PLC0415

        with files_below(run.folder):
            try:
                self._run = self._begin(run, mode_of(self.mode))
            except wandb.errors.CommError as error:
                if self.mode is not Mode.auto:
                    raise
                log.warning("wandb cannot be reached, so this run is kept offline: %s", str(error).partition("\n")[0])
                self._run = self._begin(run, "offline")
        self._run.define_metric(STEP)
        self._run.define_metric("*", step_metric=STEP, step_sync=True)
        if self._run.url:
            log.info("wandb: %s", self._run.url)
        return WandbLogger(experiment=self._run)

    def finish(self, run: Run) -> None:
        if self._run is None:
            return
        with files_below(run.folder):
            try:
                self._tell(run)
            finally:
                self._run.finish(exit_code=EXIT_CODES.get(run.status, FAILED))
        if self._run.offline:
            log.info("wandb: offline; to send this run: wandb sync %s", quote(str(Path(self._run.dir).parent)))

    def _begin(self, run: Run, mode: Any) -> Any:
        """The run as wandb knows it."""
        import wandb  # noqa: PLC0415

        return wandb.init(
            **self.options,
            name=run.name or None,
            group=self.group or run.group or None,
            notes=" ".join(f"{key}={value}" for key, value in run.chosen.items()) or None,
            config=dict(run.settings),
            dir=str(run.folder),
            mode=mode,
        )

    def _tell(self, run: Run) -> None:
        """Hand over what is there at the end."""
        import wandb  # noqa: PLC0415

        for step, jpeg in run.frames.items():
            with Image.open(io.BytesIO(jpeg)) as frame:
                self._run.log({"frames": wandb.Image(frame, file_type="jpg"), STEP: step})
        shown: dict[str, Any] = {name: wandb.Image(str(path)) for name, path in run.pictures.items()}
        if run.metrics:
            row = {name: value for name, value in run.metrics.items() if not isinstance(value, list | dict)}
            shown["metrics"] = wandb.Table(columns=list(row), data=[list(row.values())])
            self._run.summary.update({name: value for name, value in row.items() if value is not None})
        if shown:
            self._run.log({**shown, STEP: run.step})
        for name, path in run.files.items():
            artifact = wandb.Artifact(f"{name}-{self._run.id}", type=name, metadata=run.numbers)
            artifact.add_file(str(path), policy="immutable", skip_cache=True)
            self._run.log_artifact(artifact)


def mode_of(mode: Mode) -> Any:
    """The mode as wandb calls it; None leaves it to WANDB_MODE."""
    import wandb  # noqa: PLC0415

    if mode is not Mode.auto:
        return mode.value
    return None if wandb.setup().settings.mode != "online" or is_logged_in() else "offline"


def is_logged_in() -> bool:
    """Whether wandb knows an account: from the environment, its settings or a netrc file. Nobody is asked."""
    import wandb  # noqa: PLC0415

    settings = wandb.setup().settings
    if settings.api_key or settings.identity_token_file:
        return True
    host = urlsplit(settings.base_url).netloc
    names = ONE_SERVICE if host in ONE_SERVICE else (host,)
    path = Path(os.environ.get("NETRC", "~/.netrc")).expanduser()
    try:
        return not netrc.netrc(path).hosts.keys().isdisjoint(names)
    except (OSError, netrc.NetrcParseError):
        return False


@contextmanager
def files_below(folder: Path) -> Iterator[None]:
    """Let wandb keep all its files below ``folder``, where else some would go into the user's home."""
    added = {key: str(folder / "wandb") for key in ("WANDB_DATA_DIR", "WANDB_CACHE_DIR") if key not in os.environ}
    os.environ.update(added)
    try:
        yield
    finally:
        for key in added:
            del os.environ[key]
