"""Bring settings and checkpoints that earlier versions have recorded to what this version reads."""

from collections.abc import Mapping
from typing import Any

OF_TUBES = ("tubes", "mixtures", "brushes", "width_cm", "load")  # keys of what was task=tubes
TASKS = {"guided": "guides", "repaint": "region", "tubes": "tubes"}  # tasks that are changes now
REMOVED = ("lpips_backbone", "lpips_weights", "model")  # keys that no task has any more
OF_TRAININGS = (  # options of Lightning's Trainer that only trainings have now
    *("accumulate_grad_batches", "check_val_every_n_epoch", "limit_train_batches", "limit_val_batches"),
    *("max_epochs", "min_epochs", "min_steps", "val_check_interval"),
)
KEYS = {"guides": "change.guides.lines", "region": "change.region.mask", "tubes": "change.tubes.tubes"}  # of files


def is_earlier(settings: Mapping[str, Any]) -> bool:
    """Tell whether recorded settings are of a version in which changes of a painting had keys of their own."""
    return "change" not in settings and bool({"variety", "wet", "tubes"} & settings.keys())


def todays_settings(recorded: Mapping[str, Any]) -> dict[str, Any]:
    """Return recorded settings of a painting under the keys of today; today's own stay as they are.

    What was a task, a callback or a key of its own may be a change: ``variety: 0.4`` of old is
    ``change: {variety: {amount: 0.4}}``.

    >>> todays_settings({"task": "paint", "variety": 0.4, "wet": 0})
    {'task': 'paint', 'change': {'variety': {'amount': 0.4, '_target_': 'change/variety'}}}
    """
    settings = {key: value for key, value in recorded.items() if key not in REMOVED}
    if "pixels_per_stroke" in settings:  # of a painting
        settings.setdefault("working_resolution", None)  # all pixels were
    if not is_earlier(settings):
        return settings
    if "trainer" in settings:
        options = _mapping(settings["trainer"])
        settings["trainer"] = {key: options[key] for key in options if key not in OF_TRAININGS}
    if settings.get("timelapse") == "both":
        settings["timelapse"] = "mp4"
    change = {"variety": _member("variety", {"amount": settings.pop("variety", 0)})}
    callbacks = _mapping(settings.get("callbacks"))
    wet, looks = settings.pop("wet", 0), callbacks.pop("wet_steps", None)
    if wet or looks:
        change["wet"] = _member("wet", _wet_options(wet, _mapping(looks)))
    for name in ("sizes", "random_ground"):
        if name in callbacks:
            change[name] = _member(name, _mapping(callbacks.pop(name)))
    if "callbacks" in settings:
        settings["callbacks"] = callbacks
    was = str(settings.get("task", ""))
    if was == "guided":
        change["guides"] = _member("guides", {"lines": settings.pop("guides", None)})
    elif was == "repaint":
        change["region"] = _member("region", {"mask": settings.pop("region", None)})
    elif "tubes" in settings:
        change["tubes"] = _member("tubes", {key: settings.pop(key) for key in OF_TUBES if key in settings})
    if was in TASKS:
        settings["task"] = "paint"
    return {**settings, "change": change}


def todays_key(key: str, recorded: Mapping[str, Any]) -> str:
    """Return the key of today for one of recorded settings that names a file."""
    return KEYS.get(key, key) if is_earlier(recorded) else key


def _mapping(value: Any) -> dict[str, Any]:
    """Copy a mapping; whatever else a record holds is an empty one."""
    return dict(value) if isinstance(value, Mapping) else {}


def _member(name: str, options: Mapping[str, Any]) -> dict[str, Any]:
    """Write the node of a member."""
    return {**options, "_target_": f"change/{name}"}


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
