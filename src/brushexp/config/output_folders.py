"""Choose the output folder of a run if the user does not set ``output``."""

from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf

from brushexp.results.exports import FOLDER, run_around

MOMENT = "${now:%Y-%m-%d_%H-%M-%S}"
BY_TIME = f"outputs/{MOMENT}"
BESIDE_PAINTING = "${beside_painting:}/" + MOMENT


def beside_painting(*, _root_: DictConfig) -> str:
    """Return the folder for an export's records: ``exports`` in the run folder of ``catalogue``, or ``outputs``.

    It is ``outputs`` in a sweep, or if the catalogue is not in a run folder, or if the run folder is read-only.
    """
    run = run_beside(_root_)
    return "outputs" if run is None else str(run / FOLDER)


def run_beside(cfg: DictConfig) -> Path | None:
    """Return the folder of the run whose painting is exported, or None if the export is written elsewhere."""
    plain: Any = OmegaConf.to_container(cfg, resolve=False)
    catalogue, hydra = plain.get("catalogue"), plain.get("hydra") or {}
    is_job = getattr(hydra.get("mode"), "name", None) == "MULTIRUN"
    if not isinstance(catalogue, str) or "${" in catalogue or is_job or plain["output"] != BESIDE_PAINTING:
        return None
    return run_around(catalogue)


OmegaConf.register_new_resolver("beside_painting", beside_painting, replace=True)
