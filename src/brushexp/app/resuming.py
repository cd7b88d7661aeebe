"""Continuing a run that was interrupted, with its own settings."""

from pathlib import Path

from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig, OmegaConf

from brushexp.app.composition import check
from brushexp.errors import UserError

CHECKPOINT = "checkpoint.ckpt"  # in a run's folder
OVERRIDABLE = ("output", "device", "threads", "checkpoint_every")  # keys that may change when a run is resumed


def interrupted_run(folder: Path, cfg: DictConfig) -> tuple[Path, DictConfig]:
    """Checkpoint and settings of a run that is to be continued.

    Raises:
        UserError: if there is nothing to continue there, or the command line changes what must stay.
    """
    settings, checkpoint = folder / ".hydra" / "config.yaml", folder / CHECKPOINT
    for path in (settings, checkpoint):
        if not path.is_file():
            raise UserError(f"resume={folder}: there is no {path.name}; give the folder of an interrupted run")
    for override in HydraConfig.get().overrides.task:
        if override.lstrip("+~").partition("=")[0] not in (*OVERRIDABLE, "resume", "task"):
            raise UserError(f"resume continues a run with its own settings; drop {override}")
    kept = OmegaConf.load(settings)
    assert isinstance(kept, DictConfig)
    kept.merge_with({key: cfg[key] for key in OVERRIDABLE})
    check(kept)
    return checkpoint, kept
