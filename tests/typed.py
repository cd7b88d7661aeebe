"""Words of the command line, set in a config that is composed already."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from copy import deepcopy
from functools import cache

from hydra._internal.config_loader_impl import ConfigLoaderImpl
from hydra.core.override_parser.overrides_parser import OverridesParser
from omegaconf import DictConfig, OmegaConf, read_write

from brushexp.config.compose import chosen_groups, composed

PARSER = OverridesParser.create()
GROUPS = chosen_groups()
_composed = cache(lambda *words: composed(words))


@contextmanager
def configured(words: Sequence[str]) -> Iterator[DictConfig]:
    """The config of words; what several choose alike is composed once, and their values are set in it."""
    names = {word: word.partition("=")[0].lstrip("+~") for word in words}
    choices = [word for word in words if names[word] in GROUPS or "/" in names[word]]
    with typed_into(_composed(*choices), [word for word in words if word not in choices]) as cfg:
        yield cfg


@contextmanager
def typed_into(cfg: DictConfig, words: Sequence[str]) -> Iterator[DictConfig]:
    """Set words of the command line in a config as Hydra does, and restore its values."""
    overrides = PARSER.parse_overrides(list(words))
    names = [override.key_or_group for override in overrides]
    before = {
        name: "???" if OmegaConf.is_missing(cfg, name) else deepcopy(OmegaConf.select(cfg, name)) for name in names
    }
    try:
        ConfigLoaderImpl._apply_overrides_to_config(overrides, cfg)
        yield cfg
    finally:
        with read_write(cfg):
            for name, value in before.items():
                OmegaConf.update(cfg, name, value, merge=False)
