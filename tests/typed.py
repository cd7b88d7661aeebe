"""Words of the command line, set in a config that is composed already."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from copy import deepcopy

from hydra._internal.config_loader_impl import ConfigLoaderImpl
from hydra.core.override_parser.overrides_parser import OverridesParser
from omegaconf import DictConfig, OmegaConf, read_write

from brushexp.cli.program import expand_arguments

PARSER = OverridesParser.create()


@contextmanager
def typed_into(cfg: DictConfig, words: Sequence[str]) -> Iterator[DictConfig]:
    """Set words of the command line in a config as Hydra does, and restore its values."""
    overrides = PARSER.parse_overrides(expand_arguments(words))
    before = {override.key_or_group: deepcopy(OmegaConf.select(cfg, override.key_or_group)) for override in overrides}
    try:
        ConfigLoaderImpl._apply_overrides_to_config(overrides, cfg)
        yield cfg
    finally:
        with read_write(cfg):
            for name, value in before.items():
                OmegaConf.update(cfg, name, value, merge=False)
