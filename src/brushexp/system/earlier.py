"""Bring settings and checkpoints that earlier versions have recorded to what this version reads."""

from collections.abc import Mapping
from typing import Any

MEMBERS = "brushexp.plugins.change"
OF_TUBES = ("tubes", "mixtures", "brushes", "width_cm", "load")  # keys of what was task=tubes
MOVED = {"brushexp_tubes.": "brushexp_changes.tubes."}  # beginnings of where plugins that are no changes were defined
TASKS = {"guided": "guides", "repaint": "region", "tubes": "tubes"}  # tasks that are changes now
KEYS = {"guides": "change.guides.lines", "region": "change.region.mask", "tubes": "change.tubes.tubes"}  # of files


def is_earlier(settings: Mapping[str, Any]) -> bool:
    """Tell whether recorded settings are of a version in which changes of a painting had keys of their own."""
    return "change" not in settings and bool({"variety", "wet", "tubes"} & settings.keys())


def todays_settings(recorded: Mapping[str, Any]) -> dict[str, Any]:
    """Return recorded settings of a painting under the keys of today; today's own stay as they are.

    What was a task, a callback or a key of its own may be a change: ``variety: 0.4`` of old is
    ``change: {variety: {amount: 0.4}}``.

    >>> todays_settings({"task": "paint", "variety": 0.4, "wet": 0})
    {'task': 'paint', 'change': {'variety': {'amount': 0.4, '_target_': 'brushexp.plugins.change.variety.Variety'}}}
    """
    settings = dict(recorded)
    if not is_earlier(settings):
        return settings
    settings = {key: _moved(value) for key, value in settings.items()}
    change = {"variety": _member("variety", "Variety", {"amount": settings.pop("variety", 0)})}
    callbacks = _mapping(settings.get("callbacks"))
    wet, looks = settings.pop("wet", 0), callbacks.pop("wet_steps", None)
    if wet or looks:
        change["wet"] = _member("wet", "Wet", _wet_options(wet, _mapping(looks)))
    for name, class_name in (("sizes", "Sizes"), ("random_ground", "RandomGround")):
        if name in callbacks:
            change[name] = _member(name, class_name, _mapping(callbacks.pop(name)))
    if "callbacks" in settings:
        settings["callbacks"] = callbacks
    was = str(settings.get("task", ""))
    if was == "guided":
        change["guides"] = _member("guides", "Guides", {"lines": settings.pop("guides", None)})
    elif was == "repaint":
        change["region"] = _member("region", "Region", {"mask": settings.pop("region", None)})
    elif "tubes" in settings:
        change["tubes"] = _member("tubes", "OfTubes", {key: settings.pop(key) for key in OF_TUBES if key in settings})
    if was in TASKS:
        settings["task"] = "paint"
    return {**settings, "change": change}


def todays_key(key: str, recorded: Mapping[str, Any]) -> str:
    """Return the key of today for one of recorded settings that names a file."""
    return KEYS.get(key, key) if is_earlier(recorded) else key


def _moved(value: Any) -> Any:
    """Return a value with the places of today where it names plugins that have moved."""
    if isinstance(value, Mapping):
        return {key: _moved(one) for key, one in value.items()}
    prefix = next((one for one in MOVED if isinstance(value, str) and value.startswith(one)), None)
    return value if prefix is None else MOVED[prefix] + value.removeprefix(prefix)


def _mapping(value: Any) -> dict[str, Any]:
    """Copy a mapping; whatever else a record holds is an empty one."""
    return dict(value) if isinstance(value, Mapping) else {}


def _member(name: str, class_name: str, options: Mapping[str, Any]) -> dict[str, Any]:
    """Write the node of a member, by the name that it would have in the core."""
    return {**options, "_target_": f"{MEMBERS}.{name}.{class_name}"}


def _wet_options(amount: float, looks: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options of wet paint of which steps may have known by a callback, ``looks``."""
    own = looks.get("wet")
    options = {key: looks[key] for key in ("every", "after") if key in looks}
    return {"amount": amount if own is None else own} | options


def todays_loops(loops: dict[str, Any]) -> None:
    """Bring the loops of Lightning in a checkpoint, which is changed, to those of painters that optimise by hand.

    Earlier ones were optimised by Lightning, which counted the steps elsewhere, and had a loader with a state.
    """
    loops["state_dict"]["combined_loader"] = []
    before = loops["epoch_loop.automatic_optimization.optim_progress"]["optimizer"]["step"]
    now = loops["epoch_loop.manual_optimization.optim_step_progress"]
    for scope in ("total", "current"):
        if not now[scope]["completed"]:
            now[scope] |= {key: before[scope][key] for key in ("ready", "completed")}
