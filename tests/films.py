"""Reading films back."""

from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from PIL import Image


def decoded(path: Path) -> tuple[list[np.ndarray], Fraction]:
    """Pictures (H, W, 3) of a video, one per tick, and its ticks per second."""
    av = pytest.importorskip("av")
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        return [frame.to_ndarray(format="rgb24") for frame in container.decode(stream)], stream.average_rate


def unrolled(path: Path) -> tuple[list[np.ndarray], list[int]]:
    """Pictures (H, W, 3) of a GIF as they are seen, and how long each stays in milliseconds."""
    pictures, durations = [], []
    with Image.open(path) as gif:
        for k in range(gif.n_frames):
            gif.seek(k)
            pictures.append(np.asarray(gif.convert("RGB")))
            durations.append(gif.info["duration"])
    return pictures, durations
