"""Helpers that write and read films and pictures."""

import io
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from brushexp.pictures.video import filming


def pixels_of(path: Path | io.BytesIO) -> np.ndarray:
    """Read a picture with Pillow as signed integers, which can be subtracted."""
    with Image.open(path) as image:
        return np.asarray(image).astype(int)


def decoded(path: Path) -> tuple[list[np.ndarray], Fraction]:
    """Read all frames (H, W, 3) of a video and its frame rate."""
    av = pytest.importorskip("av")
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        return [frame.to_ndarray(format="rgb24") for frame in container.decode(stream)], stream.average_rate


def unrolled(path: Path) -> tuple[list[np.ndarray], list[int]]:
    """Read the displayed frames (H, W, 3) of a GIF and their durations in milliseconds."""
    pictures, durations = [], []
    with Image.open(path) as gif:
        for k in range(gif.n_frames):
            gif.seek(k)
            pictures.append(np.asarray(gif.convert("RGB")))
            durations.append(gif.info["duration"])
    return pictures, durations


def scene(n: int, side: int = 64, speed: int = 3) -> list[np.ndarray]:
    """Make ``n`` frames (H, W, 3) in which a piece of one photograph moves across another."""
    from skimage import data, transform  # noqa: PLC0415

    def small(picture: np.ndarray, size: int) -> np.ndarray:
        return (255 * transform.resize(picture, (size, size), anti_aliasing=True)).astype(np.uint8)

    still, piece = small(data.coffee()[:, 100:500], side), small(data.chelsea()[20:280, 110:370], side // 3)
    pictures = []
    for k in range(n):
        picture, left = still.copy(), side // 8 + speed * k
        picture[side // 3 : side // 3 + len(piece), left : left + len(piece)] = piece
        pictures.append(picture)
    return pictures


def encoded(path: Path, pictures: list[np.ndarray], rate: int = 25) -> Path:
    """Encode pictures as an mp4 video, which adds compression noise."""
    with filming(path.with_suffix(""), "mp4", pictures[0].shape[:2], Fraction(rate)) as film:
        for picture in pictures:
            film.show(picture, 1)
    return path


def as_tensor(picture: np.ndarray) -> torch.Tensor:
    return torch.from_numpy(np.moveaxis(picture, 2, 0) / np.float32(255)).contiguous()
