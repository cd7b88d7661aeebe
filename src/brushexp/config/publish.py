"""Load all plugins and publish tasks, looks and presets to Hydra."""

import atexit
import shutil
from collections.abc import Collection, Mapping, Sequence
from functools import cache, partial
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

from hydra.core.config_store import ConfigStore
from hydra.core.plugins import Plugins
from omegaconf import OmegaConf

from brushexp.compat.hydra import store_when_read
from brushexp.config.compose import files_of, folders_of, load_config
from brushexp.config.keys import without_class
from brushexp.config.looks import LOOK_OPTIONS, check_options, publish_looks
from brushexp.config.own_files import check_own_files
from brushexp.config.tasks import TASKS
from brushexp.errors import UserError
from brushexp.registry import MULTI_SELECT, plugins
from brushexp.registry.loading import load_plugins
from brushexp.system.published import entry_points_of
from brushexp.system.reading import decode_text
from hydra_plugins.brushexp_settings import SettingsSweeperConf


@cache
def scratch_folder() -> str:
    """Create a temporary folder, removed when the program ends, for tasks that write no files of their own."""
    folder = mkdtemp(prefix="brushexp-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


OmegaConf.register_new_resolver("scratch", scratch_folder, replace=True)
MEMBERS = "members"  # group of the families of each task, which are chosen before options of looks
SWEEPERS = "brushexp.sweepers"  # entry-point group: name -> function that returns the config of a sweeper, or None
PUBLISHER = "brushexp"  # owner of a config in Hydra's store


def prepare(root: Path, words: Sequence[str] = (), *, warns: bool = True) -> None:
    """Register all plugins, import ``root/plugins``, and publish tasks and presets to Hydra.

    With ``warns``, files that are left out are reported. The worker processes of a sweep do not set ``warns``, because
    their parent has already reported these files.
    """
    load_plugins(root / "plugins", warns=warns)
    folders = folders_of(root, words)
    offer(folders, left_out=check_own_files(folders, words, warns=warns))


def offer(folders: Sequence[Path], left_out: Collection[Path] = ()) -> None:
    """Publish tasks, looks, sweepers, and presets for families that allow several members."""
    for folder in folders:
        for family in MULTI_SELECT:
            files = files_of(folder, family)
            offer_presets(family, {name: path for name, path in files.items() if path not in left_out})
    offer_tasks(publish_looks(folders, TASKS["paint"], left_out))
    offer_sweepers()


def offer_tasks(tuned: Collection[str]) -> None:
    """Publish every task as a choice in Hydra's ``task`` group; looks set options in the ``tuned`` families.

    A run reads only one of the tasks, so configs are built when they are read.
    """
    for name in TASKS:
        store_when_read(MEMBERS, name, partial(members_of_task, name), PUBLISHER, package=None)
        store_when_read("task", name, partial(config_of_task, name, tuned), PUBLISHER)


def members_of_task(name: str) -> Any:
    """Build a task's defaults list, which chooses the members of its families."""
    return OmegaConf.create({"defaults": [{f"/{group}": chosen} for group, chosen in TASKS[name].groups.items()]})


def config_of_task(name: str, tuned: Collection[str]) -> Any:
    """Build the config of a task: its defaults list, keys and settings."""
    schema = TASKS[name]
    options = []
    if "look" in schema.presets:
        options = [{f"optional /{LOOK_OPTIONS}/{family}@{family}": f"${{look}}_${{{family}}}"} for family in tuned]
    presets = [{f"/{group}": chosen} for group, chosen in schema.presets.items()]
    several: dict[str, Any] = {family: {} for family in MULTI_SELECT if family in schema.groups}  # needed for loss=[]
    head = {"defaults": [f"/{MEMBERS}/{name}@_global_", *options, "_self_", *presets], "task": name, **several}
    return OmegaConf.merge(head, without_class(OmegaConf.structured(schema)), schema.settings)


def offer_presets(family: str, paths: Mapping[str, Path]) -> None:
    """Publish YAML files as members of a family that allows several: ``loss=name``.

    Without this, Hydra would put the values in ``conf/loss/name.yaml`` beside the losses, not below ``loss.name``.
    Files that list several members or name their package are left to Hydra. Raises a UserError for a file that has the
    name of a plugin or that sets an option which its plugin lacks.
    """
    for name, path in paths.items():
        if any(name == plugin.name for plugin in plugins(family)):
            raise UserError(f"{path} has the name of the plugin {family}={name}; give the file another name")
        values: Any = {} if decode_text(path.read_bytes()).startswith("# @package") else load_config(path)
        bases = [str(base).removesuffix("@_here_") for base in values.pop("defaults", []) if base != "_self_"]
        if len(bases) == 1 and bases[0] not in (name, *values):
            check_options(path, family, bases[0], values)
            node = {"defaults": [f"{bases[0]}@_here_", "_self_"], **values}
            package = f"{family}.{name}"
            ConfigStore.instance().store(group=family, name=name, node=node, package=package, provider=str(path))


def offer_sweepers() -> None:
    """Replace Hydra's basic sweeper with the program's own, and publish the sweepers of installed packages.

    The program's sweeper takes over the name ``basic``: if it were chosen by a default in config.yaml instead, that
    default would override a study that chooses another sweeper.
    """
    Plugins.instance()  # publishes Hydra's own sweepers at first use
    ConfigStore.instance().store(group="hydra/sweeper", name="basic", node=SettingsSweeperConf, provider=PUBLISHER)
    for name, point in entry_points_of(SWEEPERS).items():
        if sweeper := point.load()():
            ConfigStore.instance().store(group="hydra/sweeper", name=name, node=sweeper, provider=PUBLISHER)
    groups = ConfigStore.instance().repo["hydra"]
    groups["sweeper"] = PinnedGroup(groups["sweeper"])


class PinnedGroup(dict[str, Any]):
    """A group whose configs Hydra cannot replace when it republishes its own configs in each worker process."""

    def __setitem__(self, name: str, node: Any) -> None:
        if name not in self or self[name].provider != PUBLISHER:
            super().__setitem__(name, node)
