"""Configs as composed from the command line, with the slow part of composing cached."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from copy import deepcopy
from functools import cache
from itertools import zip_longest

from hydra._internal.config_loader_impl import ConfigLoaderImpl
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException
from omegaconf import DictConfig, OmegaConf, read_write
from omegaconf.errors import OmegaConfBaseException

from brushexp.config.compose import CHOSEN_GROUPS, compose_config
from brushexp.registry import FAMILIES, MULTI_SELECT, plugins
from brushexp.system.words import conf_folders

PARSER = OverridesParser.create()
TASK_OF = {"engine": "simulate", "to": "export"}  # families missing from the config of task=paint
_composed = cache(lambda *words: compose_config(words))


def configured(words: Sequence[str]) -> DictConfig:
    """Compose the config for command-line words.

    The config for each combination of group choices is composed only once; other values are set in a copy of it.
    """
    names = {word: word.partition("=")[0].lstrip("+~") for word in words}
    choices = [word for word in words if names[word] in CHOSEN_GROUPS or "/" in names[word]]
    try:
        cfg = _composed(*choices).copy()
        overrides = PARSER.parse_overrides([word for word in words if word not in choices])
        if any(override.is_sweep_override() for override in overrides):
            return compose_config(words)
        _set(overrides, cfg)
    except (HydraException, OmegaConfBaseException):
        return compose_config(words)  # raises the program's own message
    return cfg


_set = ConfigLoaderImpl._apply_overrides_to_config


@contextmanager
def typed_into(cfg: DictConfig, words: Sequence[str]) -> Iterator[DictConfig]:
    """Apply command-line words to a config as Hydra does, and restore its values afterwards."""
    overrides = PARSER.parse_overrides(list(words))
    names = [override.key_or_group for override in overrides]
    before = {
        name: "???" if OmegaConf.is_missing(cfg, name) else deepcopy(OmegaConf.select(cfg, name)) for name in names
    }
    try:
        _set(overrides, cfg)
        yield cfg
    finally:
        with read_write(cfg):
            for name, value in before.items():
                OmegaConf.update(cfg, name, value, merge=False)


def members(family: str) -> list[str]:
    """Return the sorted names of a family's plugins and presets."""
    presets = [path.stem for folder in conf_folders() for path in (folder / family).glob("*.yaml")]
    return sorted([plugin.name for plugin in plugins(family)] + presets)


@cache
def nodes() -> dict[tuple[str, str], DictConfig]:
    """Return the options of every choice; each config has one choice per family, or all if a family allows several."""
    found = {}
    for task in ("paint", *TASK_OF.values()):
        families = [one for one in FAMILIES if TASK_OF.get(one, "paint") == task]
        choices = ([f"[{','.join(members(one))}]"] if one in MULTI_SELECT else members(one) for one in families)
        for row in zip_longest(*choices):
            chosen = {one: choice for one, choice in zip(families, row, strict=True) if choice}
            cfg = compose_config([f"task={task}", *(f"{one}={choice}" for one, choice in chosen.items())])
            for one, choice in chosen.items():
                several = cfg[one].items() if one in MULTI_SELECT else [(choice, cfg[one])]
                found.update({(one, key): value for key, value in several})
    return found
