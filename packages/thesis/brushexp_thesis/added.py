"""Measure other people's paintings with our own metrics, and store them in folders that resemble run folders."""

from collections.abc import Iterator, Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from brushexp.contracts import UserError, build_named
from brushexp.contracts.files import METRICS_FILE, catalogue_suffixes, to_bytes, write_json, write_picture
from brushexp.contracts.painting import export_job, measure, standard_metrics
from brushexp.contracts.pictures import load_picture, picture_suffixes
from brushexp.contracts.runs import Status
from brushexp.contracts.strokes import load_catalogue


def add_paintings(
    folder: Path, painting: Path, target: str | None, name: str, numbers: Mapping[str, Any],
    lpips_backbone: str, lpips_weights: str | None,
) -> None:  # fmt: skip
    """Measure one or more paintings, and store each in its own folder below ``folder``.

    ``painting`` is a picture, a catalogue or a folder of these; ``target`` is the picture that was painted, or a folder
    of pictures with the same names. ``name`` is the painter's name, and ``numbers`` are added to the metrics.
    """
    metrics = standard_metrics()
    if lpips_weights is not None:
        options = {"backbone": lpips_backbone, "weights": lpips_weights}
        metrics["lpips"] = build_named("metric", "lpips", options, "lpips_weights")
    for path, image in _pairs(painting, target):
        target_pixels = to_bytes(load_picture(image, None, "target"))
        pixels, strokes = draw_added(path, target_pixels.shape)
        run = folder / path.stem
        (run / ".hydra").mkdir(parents=True, exist_ok=True)
        write_picture(run / "painting.png", pixels)
        write_picture(run / "target.png", target_pixels)
        write_json(run / ".hydra" / "config.yaml", {"image": image})  # JSON is also YAML
        others = {key: value for key, value in {**numbers, **strokes}.items() if value is not None}
        others |= {"status": Status.COMPLETED, "painter": name}
        write_json(run / METRICS_FILE, measure(metrics, pixels, target_pixels) | others)


def draw_added(path: Path, shape: tuple[int, ...]) -> tuple[np.ndarray, dict[str, int]]:
    """Load a picture, or draw a catalogue without light and paper, as uint8 of the given ``shape`` (H, W, 3).

    Returns the picture and, for a catalogue, the number of strokes. Raises UserError if the picture's shape differs.
    """
    if path.suffix.lower() in catalogue_suffixes():
        saved = load_catalogue(path, "add")
        job = export_job(saved, resolution=max(shape)).bare()
        pixels, strokes = job.picture(), {"n_strokes": len(saved.strokes)}
    else:
        pixels, strokes = to_bytes(load_picture(str(path), None, "add")), {}
    if pixels.shape != shape:
        sizes = f"{pixels.shape[1]} x {pixels.shape[0]} pixels but its target {shape[1]} x {shape[0]}"
        raise UserError(
            f"add={path} has {sizes}; metrics compare pictures of equal size; give the target at the painting's size"
        )
    return pixels, strokes


def _pairs(painting: Path, target: str | None) -> Iterator[tuple[Path, str]]:
    if target is None:
        raise UserError(f"add={painting} needs the painted picture; give target=photo.jpg, or a folder of photos")
    if not painting.is_dir():
        yield painting, target
        return
    if not Path(target).is_dir():
        raise UserError(
            f"add={painting} is a folder but target={target} is not; give a folder with files of the same names"
        )
    targets = {path.stem: path for path in sorted(Path(target).iterdir()) if path.suffix.lower() in picture_suffixes()}
    known = {*picture_suffixes(), *catalogue_suffixes()}
    paths = [path for path in sorted(painting.iterdir()) if path.suffix.lower() in known]
    if not paths:
        raise UserError(f"add={painting}: the folder has no painting; give pictures or catalogues")
    for before, path in pairwise((Path(), *paths)):
        if path.stem == before.stem:
            raise UserError(f"add={path} and {before.name} both show {path.stem}; remove one of them")
        if path.stem not in targets:
            raise UserError(
                f"target={target} has no picture {path.stem} for add={path}; add it, or remove the painting"
            )
        yield path, str(targets[path.stem])
