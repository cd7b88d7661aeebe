"""The folder of a run for which no ``output`` is typed."""

import os
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf

from brushexp.strokes.storage import CATALOGUE_NAME
from brushexp.system.run_files import METRICS_FILE

MOMENT = "${now:%Y-%m-%d_%H-%M-%S}"
BY_TIME = f"outputs/{MOMENT}"
BESIDE_PAINTING = "${beside_painting:}/" + MOMENT


def beside_painting(*, _root_: DictConfig) -> str:
    """Return the folder for the exports of ``catalogue``: ``exports`` in its run, or ``outputs``.

    It is ``outputs`` for a catalogue outside a run, in a sweep, and if the run's folder is read-only.
    """
    cfg: Any = OmegaConf.to_container(_root_, resolve=False)
    catalogue, hydra = cfg.get("catalogue"), cfg.get("hydra") or {}
    if not isinstance(catalogue, str) or "${" in catalogue or getattr(hydra.get("mode"), "name", None) == "MULTIRUN":
        return "outputs"
    path = Path(catalogue).expanduser()
    folder = path if path.is_dir() else path.parent
    is_run = (folder / METRICS_FILE).is_file() and (folder / CATALOGUE_NAME).is_file()
    return str(folder / "exports") if is_run and os.access(folder, os.W_OK) else "outputs"


OmegaConf.register_new_resolver("beside_painting", beside_painting, replace=True)
