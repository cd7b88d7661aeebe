"""Publish looks (``look=oil``): override files, ``conf/look/<name>.yaml``, that define a medium or style.

A look also sets plugin options, which must not apply if the user chooses another plugin. These options are therefore
published separately, as ``look_options/<family>/<look>_<member>``. The defaults lists of tasks, and of members in
families that allow several members, load only the options of the chosen members. With ``renderer=analytic`` on the
command line, all other options of the look remain in effect.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from hydra.core.config_store import ConfigStore
from hydra.core.object_type import ObjectType
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import ConfigKeyError, OmegaConfBaseException

from brushexp.compat.hydra import move_choice, store_when_read
from brushexp.config.check import unknown_option
from brushexp.config.compose import files_of, load_config
from brushexp.config.schema import PaintTask
from brushexp.config.tasks import task_for
from brushexp.errors import UserError
from brushexp.pictures.abstraction import FEWER
from brushexp.registry import FAMILIES, MULTI_SELECT, member
from brushexp.system.reading import read_text, yaml_of
from brushexp.system.words import table_of_words

LOOK_OPTIONS = "look_options"  # group of the options that looks set: look_options/<family>/<look>_<member>
UNTUNED = "untuned"  # group of members of families that allow several, without options of looks
FAST_STARTS = "fast_start"  # group of files, one for each ``init``, that replace it in a draft
SCALED = ("steps", "pixels_per_stroke", "max_strokes", "focus_strength")  # keys of looks that other keys scale
KEEPS_SIZE = "keep_stroke_size"  # key by which a look chooses the effect of ``quality``
CLOSER = 50  # factor on the weight of the focus at abstraction=1
LAYERS = 3  # layers added at abstraction=1, so that the smallest strokes keep their size


def scale(key: str, value: float, *, _root_: DictConfig) -> int | float:
    """Scale the value of a key in a look by ``detail``, ``effort`` and ``abstraction``; integers remain integers."""
    fewer = FEWER**_root_.abstraction
    scaled: dict[str, int | float] = {
        "steps": round(value * _root_.effort),
        "pixels_per_stroke": value * fewer / _root_.detail,
        "max_strokes": round(value * _root_.detail / fewer),
        "focus_strength": value * CLOSER**_root_.abstraction,
        "layers": round(value + LAYERS * _root_.abstraction),
    }
    return scaled[key]


def fast_start(look: str, family: str) -> str:
    """Choose a family's member for a draft; for ``init``, prefer one that places strokes in a single pass.

    A config in the ``fast_start`` group names this initialiser and the matching members of other families. A look that
    imitates brushwork or tunes the optimizer keeps its own members.
    """
    store = ConfigStore.instance()
    node = store.load(f"look/{look}.yaml").node
    chosen = {of: str(name) for of, name in choices_of(node, PaintTask.groups).items()}
    file = f"{FAST_STARTS}/{chosen['init']}.yaml"
    tuned = f"{LOOK_OPTIONS}/optimizer/{look}_{chosen['optimizer']}.yaml"
    is_tuned = family == "optimizer" and store.get_type(tuned) is ObjectType.CONFIG
    if store.get_type(file) is not ObjectType.CONFIG or OmegaConf.select(node, "style.brushwork") or is_tuned:
        return chosen[family]
    replaced = store.load(file).node[family]
    return str(replaced) if family == "init" else str(replaced.get(chosen[family], chosen[family]))


def start_of_draft(look: str, family: str) -> str:
    """Choose a member for a draft: the look's own if its strokes keep their size, otherwise that of `fast_start`."""
    node = ConfigStore.instance().load(f"look/{look}.yaml").node
    return str(choices_of(node, PaintTask.groups)[family]) if node.get(KEEPS_SIZE) else fast_start(look, family)


def density_of_quality(look: str, density: str) -> str:
    """Choose the density policy for a quality: the look's own if its strokes keep their size, otherwise ``density``."""
    chosen, keeps_size = _density_of(look)
    return chosen if keeps_size else density


def density_of_look(look: str, density: str) -> str:
    """Choose as `density_of_quality` does, but also use the look's own policy if it differs from the task's default."""
    chosen, keeps_size = _density_of(look)
    return chosen if keeps_size or chosen != PaintTask.groups["density"] else density


def _density_of(look: str) -> tuple[str, bool]:
    """Return a look's density policy, and whether its strokes keep their size."""
    node = ConfigStore.instance().load(f"look/{look}.yaml").node
    return str(choices_of(node, PaintTask.groups)["density"]), bool(node.get(KEEPS_SIZE))


def by_quality(nearer: Any, finished: Any, *, _root_: DictConfig) -> Any:
    """Return ``finished`` if the look's strokes keep their size, otherwise ``nearer``; used in quality presets."""
    return finished if _root_[KEEPS_SIZE] else nearer


OmegaConf.register_new_resolver("by_quality", by_quality, replace=True)
OmegaConf.register_new_resolver("density_of_quality", density_of_quality, replace=True)
OmegaConf.register_new_resolver("density_of_look", density_of_look, replace=True)
OmegaConf.register_new_resolver("start_of_draft", start_of_draft, replace=True)
OmegaConf.register_new_resolver("scaled", scale, replace=True)
OmegaConf.register_new_resolver("fast_start", fast_start, replace=True)


def publish_looks(folders: Sequence[Path], schema: type[Any], left_out: Collection[Path] = ()) -> set[str]:
    """Publish the looks in config folders for a task; return the single-member families whose options they set.

    Files are parsed immediately, and checked only if they are chosen.
    """
    paths = {name: path for folder in folders for name, path in files_of(folder, "look").items()}
    paths = {name: path for name, path in paths.items() if path not in left_out}
    tuned: set[str] = set()
    for name, path in paths.items():
        store_when_read("look", name, partial(_keys_of, path, schema), str(path))
        for family, chosen in _tuned_members(_parse(path), schema.groups):
            options = partial(_options_of, path, family, chosen, schema.groups)
            store_when_read(f"{LOOK_OPTIONS}/{family}", f"{name}_{chosen}", options, str(path), package=None)
            if family in MULTI_SELECT:
                _make_tunable(family, chosen)
            else:
                tuned.add(family)
    for folder in folders:
        for name, path in files_of(folder, FAST_STARTS).items():
            store_when_read(FAST_STARTS, name, partial(load_config, path), str(path))
    return tuned


def look_names() -> list[str]:
    """List the published looks for ``task=paint``, in alphabetical order; looks that choose other tasks are omitted."""
    names = sorted(name.removesuffix(".yaml") for name in ConfigStore.instance().list("look"))
    return [name for name in names if task_for("paint", {"look": name}) == "paint"]


def _parse(path: Path) -> dict[str, Any]:
    """Parse a look file into plain values; an invalid file gives an empty mapping, and is reported by `_read`."""
    try:
        return _with_options_of_changes(yaml_of(read_text(path, "correct it")))
    except UserError:
        return {}


def _with_options_of_changes(look: dict[str, Any]) -> dict[str, Any]:
    """Expand short words such as ``wet: 0.5`` into the options of changes that they stand for, and choose the changes.

    Looks written for version 0.1 contain such words, and users still write them.
    """
    words = {word: option for word, option in table_of_words("change_words").items() if word in look}
    if not words or not isinstance(look.get("change") or {}, dict):
        return look
    whole = {key: value for key, value in look.items() if key not in words}
    chosen = list(choices_of(look, PaintTask.groups)["change"])
    options = dict(whole.get("change") or {})
    for word, option in words.items():
        _, name, key = option.split(".")
        if name in chosen or look[word]:
            options[name] = {**(options.get(name) or {}), key: look[word]}
            chosen += [name] if name not in chosen else []
    others = [entry for entry in look.get("defaults") or [] if "override /change" not in entry]
    return whole | {"defaults": [*others, {"override /change": chosen}], "change": options}


def _read(path: Path) -> dict[str, Any]:
    """Read a look file; raise a UserError for plugins or options where Hydra would ignore them."""
    look = _with_options_of_changes(yaml_of(read_text(path, "correct it")))
    if not look:
        raise UserError(f"{path} sets nothing; a look has lines like 'steps: 100'")
    for part in look.get("defaults") or []:
        if part != "_self_" and not (isinstance(part, dict) and all(str(key).startswith("override /") for key in part)):
            cure = "write '- override /init: slic'; one look upon another is a study with '- override /look: oil'"
            raise UserError(f"{path}: {part} in its defaults does not choose a plugin; {cure}")
    chosen = {family: look[family] for family in FAMILIES if family in look}
    several = [(family, one) for family in MULTI_SELECT for one in _values(chosen.get(family))]
    for family, options in [*chosen.items(), *several]:
        if not isinstance(options, dict):
            cure = f"put options below '{family}:', and choose it by '- override /{family}: ...' in the defaults"
            raise UserError(f"{path}: {family} is {options}; {cure}")
    return look


def _values(options: Any) -> list[Any]:
    return list(options.values()) if isinstance(options, dict) else []


def _keys_of(path: Path, schema: type[Any]) -> DictConfig:
    """Build a look's config without plugin options.

    The values of the keys in `SCALED` are scaled by ``detail``, ``effort`` and ``abstraction``.
    """
    look = _read(path)
    for family, chosen in _tuned_members(look, schema.groups):
        _options_of(path, family, chosen, schema.groups)  # raises a UserError if the plugin lacks them
    values = {key: value for key, value in look.items() if key not in FAMILIES}
    for key in SCALED:
        values[key] = _as_scaled(key, values.get(key, getattr(schema, key)))
    config: DictConfig = OmegaConf.create(values)
    return config


def _as_scaled(key: str, value: object) -> object:
    """Wrap a number in a look so that `scale` is applied to it; return other values unchanged."""
    return f"${{scaled:{key},{value}}}" if isinstance(value, int | float) else value


def _tuned_members(look: Mapping[str, Any], groups: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield the family and name of each member whose options are set by a look."""
    chosen = choices_of(look, groups)
    for family in FAMILIES:
        if family not in look:
            continue
        if family in MULTI_SELECT:
            if isinstance(look[family], dict):  # `_read` reports other values
                yield from ((family, str(name)) for name in look[family])
        elif isinstance(chosen.get(family), str):
            yield family, chosen[family]


def _options_of(path: Path, family: str, chosen: str, groups: Mapping[str, Any]) -> DictConfig:
    """Build the config of the options that a look sets for a member; raise a UserError for unknown options."""
    look = _read(path)
    options: DictConfig = OmegaConf.create(look[family][chosen] if family in MULTI_SELECT else look[family])
    check_options(path, family, chosen, options)
    if family == "init" and "layers" in options:
        options.layers = _as_scaled("layers", options.layers)
    return options


def choices_of(look: Mapping[str, Any] | DictConfig, groups: Mapping[str, Any]) -> dict[str, Any]:
    """Map each family to the members that a look chooses or, if it chooses none, to the task's default."""
    chosen = dict(groups)
    for entry in look.get("defaults") or []:
        if isinstance(entry, Mapping | DictConfig):
            chosen |= {str(key).removeprefix("override /"): value for key, value in entry.items()}
    return chosen


def check_options(path: Path, family: str, name: str, options: DictConfig) -> None:
    """Raise a UserError if a file sets options that a plugin does not have, or gives them unsuitable values."""
    if (plugin := member(family, name)) is None:
        return  # a preset, which Hydra reports
    try:
        OmegaConf.merge(OmegaConf.structured(plugin.config), options)
    except OmegaConfBaseException as error:
        is_unknown = isinstance(error, ConfigKeyError)
        reason = unknown_option(str(error.key), plugin) if is_unknown else error.msg
        raise UserError(f"{path} does not fit {family}={name}: {reason}; correct it") from error


def is_tuned(family: str, name: str) -> bool:
    """Check whether a published look sets options of the given member of a family that allows several members."""
    stored = ConfigStore.instance().get_type(f"{UNTUNED}/{family}/{name}.yaml")
    return stored is ObjectType.CONFIG


def _make_tunable(family: str, name: str) -> None:
    """Republish a member so that the options a look sets for it apply wherever it is chosen."""
    parts = [
        "_self_",
        f"/{UNTUNED}/{family}/{name}@_here_",
        {f"optional /{LOOK_OPTIONS}/{family}@_here_": f"${{look}}_{name}"},
    ]
    if move_choice(family, name, f"{UNTUNED}/{family}", by=LOOK_OPTIONS):
        store = ConfigStore.instance()
        store.store(
            group=family, name=name, node={"defaults": parts}, package=f"{family}.{name}", provider=LOOK_OPTIONS
        )
