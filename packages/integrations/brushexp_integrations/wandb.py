"""Log a run to Weights & Biases."""

from __future__ import annotations

import io
import logging
import os
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated, Any

from PIL import Image

from brushexp.contracts import UserError, one_of, register
from brushexp.contracts.families import Logger, Run
from brushexp.contracts.runs import Status

if TYPE_CHECKING:
    from lightning.pytorch.loggers import Logger as LightningLogger

log = logging.getLogger(__name__)
STEP = "trainer/global_step"  # Lightning's WandbLogger uses this name for the step of its curves
EXIT_CODES = {Status.COMPLETED: 0, Status.INTERRUPTED: 130, Status.FAILED: 1}
DEFAULTS = {  # environment variables of wandb, set unless the user has set them
    "WANDB_SILENT": "true",
    "WANDB_CONSOLE": "off",  # otherwise it records everything the program prints
    "WANDB_ERROR_REPORTING": "false",
    "WANDB_INIT_TIMEOUT": "15",  # seconds
    "WANDB_FINISH_TIMEOUT": "60",  # seconds; data not sent by then stays in the folder
}
ONE_SERVICE = ("https://api.wandb.ai", "https://api.forge.coreweave.com")  # one service under two addresses


@register("logger", "wandb")
class WeightsAndBiases(Logger):
    """Log curves, pictures, a table and the catalogue to Weights & Biases; offline unless you are logged in.

    All files are kept in the run's ``wandb`` folder; ``wandb sync`` uploads offline runs later. Errors in wandb itself
    are reported to its developers only if WANDB_ERROR_REPORTING is set to true.

    Args:
        project: project to which the runs belong.
        entity: user or team that owns the project; null = your account's default.
        mode: logging mode: online, offline, disabled (nothing is kept) or auto, which is online if you are logged in
            by WANDB_API_KEY or ``wandb login`` and offline if you are not, unless WANDB_MODE selects another mode.
        group: group in which runs are shown together; null = name of the sweep's folder.
        tags: labels by which runs can be found.
    """

    def __init__(
        self,
        *,
        project: str = "brushexp",
        entity: str | None = None,
        mode: Annotated[str, one_of("auto", "online", "offline", "disabled")] = "auto",
        group: str | None = None,
        tags: list[str] = [],  # noqa: B006
    ) -> None:
        if find_spec("wandb") is None:
            raise UserError("logger=wandb needs the package wandb; pip install 'brushexp[wandb]'")
        for key, value in DEFAULTS.items():
            os.environ.setdefault(key, value)
        if mode == "online" and not is_logged_in():
            cure = "run wandb login, or choose logger.wandb.mode=offline"
            raise UserError(f"logger.wandb.mode=online, but nobody is logged in to wandb; {cure}")
        self.mode, self.group = mode, group
        self.options: dict[str, Any] = {"project": project, "entity": entity, "tags": tags or None}
        self._run: Any = None

    def open(self, run: Run) -> LightningLogger:
        import wandb  # noqa: PLC0415
        from lightning.pytorch.loggers import WandbLogger  # noqa: PLC0415

        for key in ("WANDB_DATA_DIR", "WANDB_CACHE_DIR"):
            os.environ.setdefault(key, str(run.folder / "wandb"))  # otherwise some files go into the user's home
        begin = partial(
            wandb.init,
            **self.options,
            name=run.name or None,
            group=self.group or run.group or None,
            notes=" ".join(f"{key}={value}" for key, value in run.chosen.items()) or None,
            config=dict(run.settings),
            dir=str(run.folder),
        )
        try:
            self._run = begin(mode=mode_of(self.mode))
        except wandb.errors.CommError as error:
            log.warning("wandb cannot be reached, so this run is kept offline: %s", str(error).partition("\n")[0])
            self._run = begin(mode="offline")
        self._run.define_metric(STEP)
        self._run.define_metric("*", step_metric=STEP, step_sync=True)
        if self._run.url:
            log.info("wandb: %s", self._run.url)
        return WandbLogger(experiment=self._run)

    def finish(self, run: Run) -> None:
        if self._run is None:
            return
        try:
            self._log(run)
        finally:
            self._run.finish(exit_code=EXIT_CODES[run.status])
        if self._run.offline:
            log.info("wandb: offline; to send this run: wandb sync %s", quote(str(Path(self._run.dir).parent)))

    def _log(self, run: Run) -> None:
        import wandb  # noqa: PLC0415

        for step, jpeg in run.frames.items():
            self._run.log({"frames": wandb.Image(Image.open(io.BytesIO(jpeg)), file_type="jpg"), STEP: step})
        entries: dict[str, Any] = {name: wandb.Image(str(path)) for name, path in run.pictures.items()}
        if run.metrics:
            entries["metrics"] = wandb.Table(columns=list(run.row), data=[list(run.row.values())])
            self._run.summary.update(run.row)
        self._run.log({**entries, STEP: run.step})
        for name, path in run.files.items():
            artifact = wandb.Artifact(f"{name}-{self._run.id}", type=name, metadata=run.numbers)
            artifact.add_file(str(path), policy="immutable", skip_cache=True)
            self._run.log_artifact(artifact)


def mode_of(mode: str) -> Any:
    """Convert the ``mode`` option to wandb's mode; None leaves the choice to WANDB_MODE."""
    import wandb  # noqa: PLC0415

    if mode != "auto":
        return mode
    return None if wandb.setup().settings.mode != "online" or is_logged_in() else "offline"


def is_logged_in() -> bool:
    """Check offline whether wandb credentials are present in the environment, the settings or the netrc file."""
    import wandb  # noqa: PLC0415
    from requests.utils import get_netrc_auth  # noqa: PLC0415  (wandb needs it, too)

    settings = wandb.setup().settings
    hosts = ONE_SERVICE if settings.base_url in ONE_SERVICE else (settings.base_url,)
    return bool(settings.api_key or settings.identity_token_file or any(map(get_netrc_auth, hosts)))
