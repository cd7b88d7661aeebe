"""Reopen a catalogue with the renderer, colour space, paper and lamp recorded in it, or with a chosen renderer."""

import logging
import math
from dataclasses import fields, replace
from typing import Any

from omegaconf import DictConfig, OmegaConf

from brushexp.errors import UserError
from brushexp.plugins.blend.base import Blend
from brushexp.plugins.color.base import ColorSpace
from brushexp.plugins.export.base import LARGEST_SIDE_PIXELS, ExportJob
from brushexp.plugins.renderer.base import Renderer
from brushexp.registry import build, build_named, plain_config, plugin_of
from brushexp.shading.light import BOUNDS, Light
from brushexp.strokes.saved import Saved
from brushexp.system.earlier import todays_settings
from brushexp.system.reading import shorten_value, yaml_of

log = logging.getLogger(__name__)


def export_job(
    saved: Saved, renderer: Renderer | None = None, blend: Blend | None = None, *, resolution: int | None = None,
    source: str = "",
) -> ExportJob:  # fmt: skip
    """Create an export job from a saved painting, with the colour space, paper and lamp in its settings.

    By default, the job keeps the renderer and size of the painting and uses ``blend=tiled``; ``renderer``, ``blend``
    and ``resolution`` (pixels on the longer side) override these. ``source`` is the file or picture that titles name.
    """
    side = resolution or max(saved.size)
    if side > LARGEST_SIDE_PIXELS:
        raise UserError(f"resolution={side} is more than {LARGEST_SIDE_PIXELS} pixels; choose a smaller one")
    parts = renderer or renderer_of(saved), blend or build_named("blend", "tiled", {}), space_of(saved)
    job = ExportJob(saved, *parts, light_of(saved), source, _member_of(saved, "paper"))
    return job if resolution is None else job.scaled(side / max(saved.size))


def renderer_of(saved: Saved) -> Renderer:
    """Build a catalogue's renderer, which must be registered, so that a file cannot make us run arbitrary code."""
    return build_named("renderer", saved.renderer, recorded_settings(saved)["renderer"])


def with_renderer(saved: Saved, chosen: DictConfig | None, path: str) -> tuple[Saved, Renderer]:
    """Build the ``chosen`` renderer and record it in the catalogue, or build the catalogue's own if none is chosen.

    Error messages name the catalogue's ``path``.
    """
    if chosen is None:
        try:
            name, renderer = saved.renderer, renderer_of(saved)
        except UserError as error:
            raise UserError(
                f"{path} was painted with renderer={saved.renderer}, which cannot be built here: {error}; "
                "otherwise draw it with renderer=analytic"
            ) from error
    else:
        name, renderer = plugin_of(chosen).name, build(chosen)
    if name == saved.renderer and renderer.weights_hash != saved.renderer_hash:
        log.warning(
            "%s was painted with other weights of renderer=%s, so the picture will differ; "
            "to use its weights, type renderer=%s renderer.checkpoint=...",
            path, saved.renderer, saved.renderer,
        )  # fmt: skip
    if chosen is None:
        return saved, renderer
    settings = recorded_settings(saved) | {"renderer": OmegaConf.to_container(chosen, resolve=True)}
    config = OmegaConf.to_yaml(OmegaConf.create(settings))
    return replace(saved, renderer=name, renderer_hash=renderer.weights_hash, config=config), renderer


def space_of(saved: Saved) -> ColorSpace:
    """Build the colour space in which a catalogue was painted."""
    return _member_of(saved, "color") or build_named("color", "rgb", {})


def _member_of(saved: Saved, family: str) -> Any:
    """Build the member of a family that a catalogue names, or return None if it does not name one.

    The member must be registered, so that a file cannot make us run arbitrary code.
    """
    node = recorded_settings(saved).get(family)
    if not node:
        return None
    if not isinstance(node, dict) or "_target_" not in node or plugin_of(plain_config(node), family).family != family:
        cure = f"write {family}: {{}} there for the default of old catalogues"
        raise UserError(f"{family} is {shorten_value(node)} in the config of the catalogue; {cure}")
    return build(plain_config(node), family=family)


def light_of(saved: Saved) -> Light:
    """Read the lamp of a catalogue; if its settings do not name one, return a lamp that has no effect."""
    options = recorded_settings(saved).get("light") or {}
    if not isinstance(options, dict):
        raise UserError(f"light is {shorten_value(options)} in the config of the catalogue; write light: {{}} for none")
    lamp = {item.name: options[item.name] for item in fields(Light) if item.name in options}
    for name, value in lamp.items():
        if not isinstance(value, int | float) or not math.isfinite(value):
            raise UserError(
                f"light.{name} in the config of the catalogue is {shorten_value(value)}; a number is needed"
            )
        BOUNDS[name].check(f"light.{name}", value)
    return Light(**lamp)


def recorded_settings(saved: Saved) -> dict[str, Any]:
    """Read a catalogue's settings, with its renderer's options under ``renderer``."""
    try:
        settings = todays_settings(yaml_of(saved.config))
        options = settings.get("renderer", {})
        if not isinstance(options, dict):
            raise UserError(f"renderer is {shorten_value(options)}; write renderer: {{}} there")
        plain_config(options)
    except UserError as error:
        raise UserError(
            f"the config of the catalogue cannot be read ({error}); correct it, or make it empty"
        ) from error
    return {**settings, "renderer": {str(key): value for key, value in options.items() if str(key)[:1] != "_"}}
