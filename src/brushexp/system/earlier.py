"""Convert settings and checkpoints from earlier versions to the current version."""

from collections.abc import Mapping
from typing import Any

TUBES_KEYS = ("tubes", "mixtures", "brushes", "width_cm", "load")  # keys of the former task=tubes
TASKS = {"guided": "guides", "repaint": "region", "tubes": "tubes"}  # former tasks that are now changes
REMOVED = ("lpips_backbone", "lpips_weights", "model")  # keys that no longer exist
TRAINING_OPTIONS = (  # Trainer options that only training tasks still have
    *("accumulate_grad_batches", "check_val_every_n_epoch", "limit_train_batches", "limit_val_batches"),
    *("max_epochs", "min_epochs", "min_steps", "val_check_interval"),
)
# Keys that name files -> their current names.
KEYS = {"guides": "change.guides.lines", "region": "change.region.mask", "tubes": "change.tubes.tubes"}


def is_earlier(settings: Mapping[str, Any]) -> bool:
    """Return whether recorded settings come from a version that had no ``change`` plugins."""
    return "change" not in settings and bool({"variety", "wet", "tubes"} & settings.keys())


def todays_settings(recorded: Mapping[str, Any]) -> dict[str, Any]:
    """Convert recorded settings of a painting to current keys; current settings are returned unchanged.

    Some former tasks, callbacks and keys are now changes. For example, ``variety: 0.4`` becomes
    ``change: {variety: {amount: 0.4}}``.

    >>> todays_settings({"task": "paint", "variety": 0.4, "wet": 0})
    {'task': 'paint', 'change': {'variety': {'amount': 0.4, '_target_': 'change/variety'}}}
    """
    settings = {key: value for key, value in recorded.items() if key not in REMOVED}
    if "pixels_per_stroke" in settings:  # the settings of a painting
        settings.setdefault("working_resolution", None)  # the behaviour of earlier versions
    if not is_earlier(settings):
        return settings
    if "trainer" in settings:
        options = _copy_mapping(settings["trainer"])
        settings["trainer"] = {key: options[key] for key in options if key not in TRAINING_OPTIONS}
    if settings.get("timelapse") == "both":
        settings["timelapse"] = "mp4"
    change = {"variety": _member("variety", {"amount": settings.pop("variety", 0)})}
    callbacks = _copy_mapping(settings.get("callbacks"))
    wet, looks = settings.pop("wet", 0), callbacks.pop("wet_steps", None)
    if wet or looks:
        change["wet"] = _member("wet", _wet_options(wet, _copy_mapping(looks)))
    for name in ("sizes", "random_ground"):
        if name in callbacks:
            change[name] = _member(name, _copy_mapping(callbacks.pop(name)))
    if "callbacks" in settings:
        settings["callbacks"] = callbacks
    was = str(settings.get("task", ""))
    if was == "guided":
        change["guides"] = _member("guides", {"lines": settings.pop("guides", None)})
    elif was == "repaint":
        change["region"] = _member("region", {"mask": settings.pop("region", None)})
    elif "tubes" in settings:
        change["tubes"] = _member("tubes", {key: settings.pop(key) for key in TUBES_KEYS if key in settings})
    if was in TASKS:
        settings["task"] = "paint"
    return {**settings, "change": change}


def todays_key(key: str, recorded: Mapping[str, Any]) -> str:
    """Return the current name of a key that was recorded with a file as its value."""
    return KEYS.get(key, key) if is_earlier(recorded) else key


def _copy_mapping(value: Any) -> dict[str, Any]:
    """Copy a mapping; return an empty dictionary for any other value."""
    return dict(value) if isinstance(value, Mapping) else {}


def _member(name: str, options: Mapping[str, Any]) -> dict[str, Any]:
    """Return the config node of the change called ``name``."""
    return {**options, "_target_": f"change/{name}"}


def _wet_options(amount: float, looks: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options of wet paint from the former key, ``amount``, and the former callback, ``looks``."""
    own = looks.get("wet")
    options = {key: looks[key] for key in ("every", "after") if key in looks}
    return {"amount": amount if own is None else own} | options


def todays_loops(loops: dict[str, Any]) -> None:
    """Convert the states of Lightning's loops in a checkpoint, in place, to those of manual optimisation.

    Earlier painters used a stateful loader and Lightning's automatic optimisation, which counts its steps elsewhere.
    """
    loops["state_dict"]["combined_loader"] = []
    before = loops["epoch_loop.automatic_optimization.optim_progress"]["optimizer"]["step"]
    now = loops["epoch_loop.manual_optimization.optim_step_progress"]
    for scope in ("total", "current"):
        if not now[scope]["completed"]:
            now[scope] |= {key: before[scope][key] for key in ("ready", "completed")}
