"""Record the provenance of a run: versions, commits, the machine, and the user's plugin files."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import torch
from omegaconf import DictConfig, OmegaConf

from brushexp.registry import Plugin, family_of_key, plugin_of
from brushexp.registry.sources import digests_of
from brushexp.system.device import device_of
from brushexp.system.environment import code_state, processor, project_state, versions

Provenance = dict[str, Any]


def provenance_of(cfg: DictConfig) -> Provenance:
    """Return the provenance of a run, as described in docs/formats.md; call this when the run begins.

    It includes digests of the user's plugin files that the settings name, taken when the files were imported.
    """
    chosen = [plugin.cls for plugin in plugins_in(cfg) if not plugin.is_ours]
    return {
        "brushexp": code_state(),
        "project": project_state(Path()),
        **versions(),
        "processor": processor(),
        "gpu": gpu_of(cfg),
        "plugins": digests_of(chosen),
    }


def plugins_in(cfg: DictConfig) -> Iterator[Plugin]:
    """Yield the plugins that the settings of a run name."""
    yield from _plugins_in(OmegaConf.to_container(cfg, resolve=False), "")


def _plugins_in(value: Any, key: str) -> Iterator[Plugin]:
    if isinstance(value, dict):
        if (target := value.get("_target_")) is not None:
            yield plugin_of(OmegaConf.create({"_target_": target}), family_of_key(key))
        for name, child in value.items():
            yield from _plugins_in(child, f"{key}.{name}" if key else str(name))


def gpu_of(cfg: DictConfig) -> str | None:
    """Return the name of the CUDA GPU that a run uses, or None if it does not use one."""
    device = device_of(cfg.device) if cfg.get("device") is not None else torch.device("cpu")
    return torch.cuda.get_device_name(device) if device.type == "cuda" else None
