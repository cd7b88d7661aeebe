"""What Hydra composes: tasks and presets are offered to it, and a composed config is checked before anything runs."""

import logging
import re
from collections.abc import Iterator, Sequence
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from hydra.core.config_store import ConfigStore
from hydra.core.plugins import Plugins
from omegaconf import DictConfig, ListConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from brushexp.cli.mistakes import unknown_key, unknown_option
from brushexp.config.configs import files_of
from brushexp.config.keys import groups_of, keys_of, publish
from brushexp.config.looks import offer_looks
from brushexp.config.tasks import TASKS, task_for
from brushexp.errors import UserError
from brushexp.registry import FAMILIES, MULTI_SELECT, build, options_in, plugin_of, plugins

PUBLISHER = "brushexp"  # who has published a config
NOT_KEYS = {"task", "hydra", "experiment"}  # what stands beside keys and groups at the top of a config
STYLE_PARTS = {"style.loss": "style.image", "style.strokes": "style.brushwork"}  # losses, and keys that bring them


def offer(folders: Sequence[Path]) -> None:
    """Publish the tasks, the looks, and the presets in folders of configs for families with several members."""
    for folder in folders:
        for family in MULTI_SELECT:
            offer_presets(family, files_of(folder, family))
    looks = {name: path for folder in folders for name, path in files_of(folder, "look").items()}
    publish(TASKS, offer_looks(looks, TASKS["paint"]))
    offer_sweepers()
    store = ConfigStore.instance()
    store.repo = Uncopied(store.repo)


def offer_sweepers() -> None:
    """Put our sweepers in the place of Hydra's own and of Optuna's, under their names, in this program alone.

    A default in config.yaml would win over a study that chooses another one, and Optuna's would minimise a PSNR.
    """
    logging.getLogger("alembic").setLevel(logging.WARNING)  # which optuna imports: it tells of 30 parts that it loads
    Plugins.instance()  # they publish theirs when they are first looked for
    ours = {"basic": ("settings", "SettingsSweeperConf"), "optuna": ("optuna", "StudySweeperConf")}
    if not find_spec("hydra_plugins.hydra_optuna_sweeper"):
        del ours["optuna"]
    for name, (module, conf) in ours.items():
        node = getattr(import_module(f"hydra_plugins.brushexp_{module}"), conf)
        ConfigStore.instance().store(group="hydra/sweeper", name=name, node=node, provider=PUBLISHER)
    groups = ConfigStore.instance().repo["hydra"]
    groups["sweeper"] = OursStay(groups["sweeper"])


class Uncopied(dict[str, Any]):
    """What is published: Hydra copies all of it for each config that it composes, and then each part that it takes."""

    def __deepcopy__(self, known: dict[int, Any]) -> "Uncopied":
        return self


class OursStay(dict[str, Any]):
    """A group of configs in which Hydra replaces nothing of ours: it publishes its own anew in each worker process."""

    def __setitem__(self, name: str, node: Any) -> None:
        if name not in self or self[name].provider != PUBLISHER:
            super().__setitem__(name, node)


def offer_presets(family: str, paths: dict[str, Path]) -> None:
    """Publish YAML files as members of a family of which several can be chosen: ``loss=name``.

    Hydra by itself would put the values of ``conf/loss/name.yaml`` beside the losses instead of below ``loss.name``.
    A file that lists several members, has keys below them, or says its package itself is left to Hydra; one that has
    the name of a plugin, or sets an option that its plugin does not have, is refused (UserError).
    """
    known = {plugin.name: plugin for plugin in plugins(family)}

    def resolved(name: str) -> DictConfig | None:
        """The options of a plugin or preset with its class; None for anything else."""
        if name in known:
            return OmegaConf.structured(known[name].config)
        if name not in paths or paths[name].read_text(encoding="utf-8").startswith("# @package"):
            return None
        values = OmegaConf.load(paths[name])
        assert isinstance(values, DictConfig)
        bases = [str(base).removesuffix("@_here_") for base in values.pop("defaults", []) if base != "_self_"]
        base = resolved(bases[0]) if len(bases) == 1 and bases[0] != name else None
        if base is None or (bases[0] in values and bases[0] not in base):
            return None
        try:
            merged = OmegaConf.merge(base, values)
            assert isinstance(merged, DictConfig)
            return merged
        except OmegaConfBaseException as error:
            raise UserError(f"{paths[name]} does not fit {family}={bases[0]}: {error.msg}; correct it") from error

    for name, path in paths.items():
        if name in known:
            raise UserError(f"{path} has the name of the plugin {family}={name}; give the file another name")
        node = resolved(name)
        if node is not None:
            ConfigStore.instance().store(
                group=family, name=name, node=node, package=f"{family}.{name}", provider=str(path)
            )


def check(cfg: DictConfig, overrides: Sequence[str] = ()) -> None:
    """Stop at what is wrong with a composed config and no error of Hydra; the UserError has the override to mend it."""
    schema = TASKS[cfg.task]
    if (other := task_for(cfg.task, cfg)) != cfg.task:
        raise UserError(f"task={cfg.task} leaves this to task={other}; type brushexp task={other} and the same words")
    for family in MULTI_SELECT:
        if any(override.startswith(f"+{family}=") for override in overrides):
            raise UserError(f"+{family}=... is ignored by Hydra beside a list; name them all: '{family}=[mse,...]'")
    check_names(cfg)
    check_chosen(cfg)
    for name, key in keys_of(schema).items():
        value = OmegaConf.select(cfg, name)
        if value is None and OmegaConf.is_missing(cfg, name):
            raise UserError(f"task={cfg.task} needs {name}: {key.meaning}; add {name}=...")
        key.bounds.check(name, OmegaConf.to_object(value) if isinstance(value, ListConfig) else value, key.default)
    for path, node in nodes_of(cfg):
        for option in set(node) - {"_target_", *plugin_of(node).meanings}:
            raise UserError(unknown_option(str(option), plugin_of(node), overrides))
        needed = path not in STYLE_PARTS or OmegaConf.select(cfg, STYLE_PARTS[path]) is not None
        try_out(path, OmegaConf.to_yaml(node, resolve=True), needed)
    if cfg.get("resume") is None:  # else the settings are those of the run that goes on
        schema.check(cfg, overrides)


def check_names(cfg: DictConfig) -> None:
    """Stop when there is a key that the task does not have, at the top or below another one."""
    schema = TASKS[cfg.task]
    known = {*keys_of(schema), *groups_of(schema), *NOT_KEYS, *(group.rpartition("@")[2] for group in schema.groups)}
    above = {name.rpartition(".")[0] for name in known}
    for parent in sorted(above):
        for name in map(str, cfg[parent] if parent else cfg):
            path = f"{parent}.{name}" if parent else name
            if path not in known | above:
                raise UserError(unknown_key(path, cfg.task))


@cache
def try_out(path: str, node: str, needed: bool) -> None:
    """Stop when a plugin does not take the options in a node of a config (YAML); build it, if a job does."""
    chosen: DictConfig = OmegaConf.create(node)  # type: ignore[assignment]
    options = options_in(chosen, path)
    try:
        if needed:
            build(chosen)
    except UserError as error:
        about = re.split(r"\W", str(error), maxsplit=1)[0]  # some options do not know what is typed before them
        raise UserError(f"{path}.{error}" if about in options else str(error)) from error


def leaves(settings: Any, above: str = "") -> Iterator[tuple[str, Any]]:
    """All values of nested settings, by what is typed."""
    settings = dict(enumerate(settings)) if isinstance(settings, list) else settings
    if not isinstance(settings, dict):
        yield above, settings
        return
    for key, value in settings.items():
        yield from leaves(value, f"{above}.{key}".lstrip("."))


def check_chosen(cfg: DictConfig) -> None:
    """Stop when nothing is chosen of a family that needs a member, or options are set of one that is not chosen."""
    for family, default in TASKS[cfg.task].groups.items():
        if isinstance(default, str) and family in FAMILIES and "_target_" not in (cfg.get(family) or {}):
            names = ", ".join(plugin.name for plugin in plugins(family))
            raise UserError(f"{family} is not chosen; choose one of {names}")
    for family in [family for family in MULTI_SELECT if family in cfg]:
        for name, node in cfg[family].items():
            if not isinstance(node, DictConfig):
                choices = ", ".join(plugin.name for plugin in plugins(family))
                cure = f"type {family}.<name>.{name}={node}; a preset of one begins with 'defaults: [<name>]'"
                raise UserError(f"{family}.{name}={node} is an option of no {family}; {cure} (there are: {choices})")
        chosen = [name for name, node in cfg[family].items() if "_target_" in node]
        tuned = [name for name in cfg[family] if name not in chosen]
        if tuned:
            names = ",".join([*chosen, *tuned])
            wrong = f"{family}.{tuned[0]} is tuned but not chosen (chosen: {', '.join(chosen) or 'none'})"
            raise UserError(f"{wrong}; add it with '{family}=[{names}]' or drop the keys below {family}.{tuned[0]}")
        choices = ", ".join(plugin.name for plugin in plugins(family))
        if family == "loss" and not chosen:
            raise UserError(f"no loss is chosen, so there is nothing to optimise; try loss=mse (there are: {choices})")
        if family == "to" and not chosen:
            raise UserError(f"to=[] writes nothing; choose one or more of {choices}")


def nodes_of(cfg: DictConfig, above: str = "") -> Iterator[tuple[str, DictConfig]]:
    """What is typed before the options of each chosen plugin, and its part of the config."""
    for name, node in ((str(key), node) for key, node in cfg.items()):
        if isinstance(node, DictConfig) and (above or name in FAMILIES or name == "style"):
            if "_target_" in node:
                yield f"{above}{name}", node
            else:
                yield from nodes_of(node, f"{above}{name}.")
