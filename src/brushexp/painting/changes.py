"""Build the changes in a painting's config, in the order in which they are applied."""

from collections.abc import Callable
from typing import Any

from omegaconf import DictConfig

from brushexp.plugins.change.base import Change, by_rank
from brushexp.registry import keep_built, take_built


def build_changes(cfg: DictConfig, make: Callable[[DictConfig], Any] = take_built) -> dict[str, Change]:
    """Build the chosen changes and return them by name, lowest rank first."""
    return by_rank({str(name): make(node) for name, node in cfg.change.items()})


def changed_settings(cfg: DictConfig) -> DictConfig:
    """Return a config after its changes have adapted the settings."""
    for change in build_changes(cfg, keep_built).values():
        cfg = change.settings(cfg)
    return cfg
