"""Load all plugins, and publish tasks, looks and presets to Hydra, which composes configs of what is published."""

import logging
from collections.abc import Collection, Mapping, Sequence
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from hydra.core.config_store import ConfigStore
from hydra.core.plugins import Plugins
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from brushexp.config.compose import files_of, folders_of
from brushexp.config.keys import untied
from brushexp.config.looks import LOOK_OPTIONS, offer_looks
from brushexp.config.tasks import TASKS, load_tasks
from brushexp.errors import UserError
from brushexp.plugin_loading import load_plugins
from brushexp.registry import MULTI_SELECT, plugins

PUBLISHER = "brushexp"  # owner of a config in Hydra's store


def prepare(root: Path, words: Sequence[str] = ()) -> None:
    """Load the plugins of the program and of ``root/plugins``, and publish tasks and presets to Hydra."""
    load_tasks()
    load_plugins(root / "plugins")
    offer(folders_of(root, words))


def offer(folders: Sequence[Path]) -> None:
    """Publish the tasks, the looks, and the presets in folders of configs for families with several members."""
    for folder in folders:
        for family in MULTI_SELECT:
            offer_presets(family, files_of(folder, family))
    looks = {name: path for folder in folders for name, path in files_of(folder, "look").items()}
    offer_tasks(TASKS, offer_looks(looks, TASKS["paint"]))
    offer_sweepers()
    store = ConfigStore.instance()
    store.repo = Uncopied(store.repo)


def offer_tasks(tasks: Mapping[str, type[Any]], tuned: Collection[str] = ()) -> None:
    """Make every task, by its name, a choice of Hydra's group ``task``; looks set options of ``tuned`` families."""
    for name, schema in tasks.items():
        groups = [{f"/{group}": chosen} for group, chosen in schema.groups.items()]
        if "look" in schema.presets:
            groups += [{f"optional /{LOOK_OPTIONS}/{family}@{family}": f"${{look}}_${{{family}}}"} for family in tuned]
        presets = [{f"/{group}": chosen} for group, chosen in schema.presets.items()]
        several: dict[str, Any] = {family: {} for family in MULTI_SELECT if family in schema.groups}  # for loss=[]
        head = {"defaults": [*groups, "_self_", *presets], "task": name, **several}
        node = OmegaConf.merge(head, untied(OmegaConf.structured(schema)), schema.settings)
        ConfigStore.instance().store(group="task", name=name, node=node, package="_global_", provider=PUBLISHER)


def offer_presets(family: str, paths: dict[str, Path]) -> None:
    """Publish YAML files as members of a family of which several can be chosen: ``loss=name``.

    Hydra by itself would put the values of ``conf/loss/name.yaml`` beside the losses instead of below ``loss.name``.
    A file that lists several members, has keys below them, or says its package itself is left to Hydra; one that has
    the name of a plugin, or sets an option that its plugin does not have, is refused (UserError).
    """
    members = {plugin.name: plugin for plugin in plugins(family)}

    def resolved(name: str) -> DictConfig | None:
        """The options of a plugin or preset with its class; None for anything else."""
        if name in members:
            return OmegaConf.structured(members[name].config)
        if name not in paths or paths[name].read_text(encoding="utf-8").startswith("# @package"):
            return None
        values = OmegaConf.load(paths[name])
        assert isinstance(values, DictConfig)
        bases = [str(base).removesuffix("@_here_") for base in values.pop("defaults", []) if base != "_self_"]
        base = resolved(bases[0]) if len(bases) == 1 and bases[0] != name else None
        if base is None or (bases[0] in values and bases[0] not in base):
            return None
        try:
            return OmegaConf.merge(base, values)  # type: ignore[return-value]
        except OmegaConfBaseException as error:
            raise UserError(f"{paths[name]} does not fit {family}={bases[0]}: {error.msg}; correct it") from error

    for name, path in paths.items():
        if name in members:
            raise UserError(f"{path} has the name of the plugin {family}={name}; give the file another name")
        if (node := resolved(name)) is not None:
            package = f"{family}.{name}"
            ConfigStore.instance().store(group=family, name=name, node=node, package=package, provider=str(path))


def offer_sweepers() -> None:
    """Put our sweepers in the place of Hydra's own and of Optuna's, under their names, in this program alone.

    A default in config.yaml would win over a study that chooses another one, and Optuna's would minimise a PSNR.
    """
    logging.getLogger("alembic").setLevel(logging.WARNING)  # Optuna imports it, and it logs each part that it loads
    Plugins.instance()  # publishes Hydra's own sweepers, at first use
    ours = {"basic": ("settings", "SettingsSweeperConf"), "optuna": ("optuna", "StudySweeperConf")}
    if not find_spec("hydra_plugins.hydra_optuna_sweeper"):
        del ours["optuna"]
    for name, (module, conf) in ours.items():
        node = getattr(import_module(f"hydra_plugins.brushexp_{module}"), conf)
        ConfigStore.instance().store(group="hydra/sweeper", name=name, node=node, provider=PUBLISHER)
    groups = ConfigStore.instance().repo["hydra"]
    groups["sweeper"] = OursStay(groups["sweeper"])


class Uncopied(dict[str, Any]):
    """Published configs; Hydra copies all of them for each config that it composes, and then each part it takes."""

    def __deepcopy__(self, memo: dict[int, Any]) -> "Uncopied":
        return self


class OursStay(dict[str, Any]):
    """A group of configs in which Hydra replaces nothing of ours: it publishes its own anew in each worker process."""

    def __setitem__(self, name: str, node: Any) -> None:
        if name not in self or self[name].provider != PUBLISHER:
            super().__setitem__(name, node)
