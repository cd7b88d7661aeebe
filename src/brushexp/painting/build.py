"""Build a painter from the config of a painting."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace

from omegaconf import DictConfig
from torch import Tensor

from brushexp.painting.changes import build_changes
from brushexp.painting.components import STYLE, Components, build_components, first_strokes, plan_steps, stroke_budget
from brushexp.painting.faces import Feature, features_of, places_of
from brushexp.painting.other_painter import OtherPainter
from brushexp.painting.painting_module import PaintingModule
from brushexp.painting.stroke_optimizer import GradientClip, StrokeOptimizer
from brushexp.painting.working_size import Sizes, resolution_of, sizes_of
from brushexp.pictures.abstraction import simplify
from brushexp.pictures.color import recolor
from brushexp.pictures.face import Face
from brushexp.pictures.faces.contrast import restore_forms
from brushexp.pictures.faces.spots import Spot, find_eyes, find_spots
from brushexp.pictures.focus import AUTO, OFF, focus_map, focus_weights
from brushexp.pictures.load import TRANSPARENT, background_color, load_cutout, load_mask, load_picture
from brushexp.plugins.change.base import Change
from brushexp.plugins.loss.base import StyleLoss
from brushexp.plugins.painter.base import Painter
from brushexp.plugins.palette.base import Palette
from brushexp.registry import take_built
from brushexp.strokes.catalogue import Catalogue

log = logging.getLogger(__name__)


def build_painter(cfg: DictConfig, target: Tensor | None = None) -> PaintingModule:
    """Build the painter for a checked config of ``task=paint`` on the CPU; seed PyTorch's generators before calling.

    If given, ``target`` (3, H, W) in [0, 1] replaces the picture named by ``image``, and is neither resized nor reduced
    to the palette.
    """
    sizes = sizes_of(cfg) if target is None else None
    picture = _load(cfg, resolution_of(cfg)) if target is None else target
    painter = take_built(cfg.painter)
    faces, eyes = ([], []) if isinstance(painter, Painter) else faces_and_eyes_of(cfg, picture)
    target = _in_palette(cfg, picture, features_of(faces, eyes)) if target is None else target
    changes = build_changes(cfg)
    for change in changes.values():
        target = change.target(target)
    if isinstance(painter, Painter):
        return _other_painter(cfg, painter, target, changes)
    if faces:
        log.info("found %d face%s", len(faces), "s" if len(faces) > 1 else "")
    return _stroke_optimizer(cfg, target, faces, eyes, changes, sizes)


def target_of(cfg: DictConfig) -> Tensor:
    """Load the picture to paint (3, H, W), reduced to the palette, at the size at which strokes are optimised."""
    return _in_palette(cfg, _load(cfg, resolution_of(cfg)))


def _in_palette(cfg: DictConfig, picture: Tensor, features: Sequence[Feature] = ()) -> Tensor:
    palette: Palette = take_built(cfg.palette)
    target = palette(picture)
    if target is picture:  # the palette has flattened nothing
        return target
    places = [(feature.x, feature.y, feature.radius) for feature in features if feature.is_certain]
    return restore_forms(target, picture, places, hues=palette.has_hues)


def faces_of(cfg: DictConfig, picture: Tensor) -> list[Face]:
    """Find the faces in a picture (3, H, W) if the focus or the strokes depend on them.

    If ``faces`` is a mask, the faces that it marks are added. With ``faces=off``, or if the strokes come from a
    catalogue and the focus is not automatic, no network is loaded and the list is empty.
    """
    return faces_and_eyes_of(cfg, picture)[0]


def faces_and_eyes_of(cfg: DictConfig, picture: Tensor) -> tuple[list[Face], list[Spot]]:
    """Find the faces in a picture as `faces_of` does; if there are none, find the eyes of animals (`_seeks_spots`)."""
    if cfg.faces == OFF or not (cfg.focus == AUTO or cfg.catalogue is None):
        return [], []
    from brushexp.pictures.faces.detection import find_faces_and_heads  # noqa: PLC0415  (not every painting asks)
    from brushexp.pictures.faces.marked import marked_faces  # noqa: PLC0415

    faces, heads = find_faces_and_heads(picture)
    if cfg.faces != AUTO:
        mask = load_mask(cfg.faces, (picture.shape[1], picture.shape[2]), "faces", f"{AUTO}, {OFF}, ")
        faces += marked_faces(picture, mask, faces)
    return faces, find_eyes(picture, heads) if _seeks_spots(cfg) and not faces else []


def _seeks_spots(cfg: DictConfig) -> bool:
    """Check whether to add strokes for dark spots, such as animals' eyes, which are less certain than faces.

    They are added only if the focus is automatic and the user sets neither the number of strokes nor a catalogue.
    """
    return bool(cfg.faces != OFF and cfg.focus == AUTO and cfg.strokes is None and cfg.catalogue is None)


def spots_of(cfg: DictConfig, target: Tensor, attended: Tensor | None) -> list[Spot]:
    """Find dark spots, possibly the eyes of animals, in a target (3, H, W) with the focus map ``attended`` (H, W)."""
    if not _seeks_spots(cfg):
        return []
    assert attended is not None
    return find_spots(target, attended)


def _load(cfg: DictConfig, resolution: int | None) -> Tensor:
    if cfg.background == TRANSPARENT:
        target, alpha = load_cutout(cfg.image, resolution)
        if bool((alpha == 1).all()):
            log.warning(
                "image=%s has no transparent pixels, so background=transparent means background=mean", cfg.image
            )
        return target
    return load_picture(cfg.image, resolution)


def _other_painter(cfg: DictConfig, painter: Painter, target: Tensor, changes: Mapping[str, Change]) -> OtherPainter:
    parts, background = build_components(cfg), background_color(cfg.background, target)
    n = stroke_budget(cfg, (target.shape[1], target.shape[2]), parts.density)
    return OtherPainter(painter, parts, target, background, n=n, seed=cfg.seed, changes=changes)


def _stroke_optimizer(
    cfg: DictConfig,
    target: Tensor,
    faces: Sequence[Face],
    eyes: Sequence[Spot],
    changes: Mapping[str, Change],
    sizes: Sizes | None,
) -> StrokeOptimizer:
    pictures: dict[str, Tensor] = {}
    focus, attended = compute_focus(cfg, target, faces)
    if attended is not None:
        pictures["focus"] = attended.expand(3, -1, -1)
    target = simplify(target, cfg.abstraction, attended)
    parts = build_components(cfg)
    if cfg.style.image is not None:
        target, pictures["style"] = match_colors(target, parts)
    background = background_color(cfg.background, target)
    for change in changes.values():
        parts = replace(parts, order=change.order(parts.order))
        background = change.ground(background)
    spots = spots_of(cfg, target, attended) if not faces else []
    features = features_of(faces, [*eyes, *spots])
    painted = None if sizes is None else sizes.painting
    strokes, budget = first_strokes(cfg, target, parts.density, focus, faces, features, painted=painted)
    parts = plan_steps(parts, cfg.steps_per_stroke, strokes, (target.shape[1], target.shape[2]))
    has_steps = any(stage.steps for stage in parts.stages) or cfg.seconds
    painter = StrokeOptimizer(
        Catalogue(strokes, parts.optimizer.units),
        parts,
        target,
        background,
        seed=cfg.seed,
        focus=focus,
        features=places_of(features_of(faces, eyes), (target.shape[1], target.shape[2])),
        budget=budget,
        psnr=cfg.psnr,
        is_timed=cfg.seconds is not None,
        coarse=cfg.coarse,
        clip=clip_of(cfg),
        changes=changes,
        painted=painted,
        is_untouched=cfg.catalogue is not None and not has_steps,
    )
    painter.pictures |= pictures
    return painter


def clip_of(cfg: DictConfig) -> GradientClip | None:
    """Read the gradient clipping from the Trainer's options; return None if gradients are not clipped."""
    most, algorithm = cfg.trainer.gradient_clip_val, cfg.trainer.gradient_clip_algorithm
    return None if most is None else GradientClip(most, algorithm or "norm")


def compute_focus(cfg: DictConfig, target: Tensor, faces: Sequence[Face] = ()) -> tuple[Tensor | None, Tensor | None]:
    """Compute the pixel weights (H, W), with mean 1, and the focus map; both are None if ``focus`` is not set."""
    if cfg.focus is None:
        return None, None
    attended = focus_map(cfg.focus, target, faces)
    return focus_weights(attended, cfg.focus_strength), attended


def match_colors(target: Tensor, parts: Components) -> tuple[Tensor, Tensor]:
    """Match the colours of the target and the style picture as the style loss requires; return both pictures."""
    style = parts.losses[STYLE]
    assert isinstance(style, StyleLoss)
    picture = style.picture(target)
    return (target if style.colors == "content" else recolor(target, like=picture)), picture
