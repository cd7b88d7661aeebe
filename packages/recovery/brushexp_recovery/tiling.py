"""A picture of any size is looked at in tiles that overlap, brought to a scale and dealt out to threads."""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image

from brushexp.system.runtime import give_memory_back, keep_memory

Array = NDArray[Any]
Box = tuple[int, int, int, int]  # top, bottom, left, right
Item = TypeVar("Item")
Result = TypeVar("Result")

KEPT = 2**23  # bytes: larger arrays are given back once they are freed; the holes that they would leave fit no others
MARGIN = 64  # pixels at the borders of a tile that its neighbours know better


def tiles(height: int, width: int, zoom: float, side: int, margin: int = MARGIN) -> Iterator[tuple[Box, Box]]:
    """Cover a picture by tiles that overlap: the box of each, and that of its core, which no other core overlaps.

    A tile is at most ``side`` pixels wide once it is zoomed, and so are its margins ``margin``.
    """
    rows, columns = (list(_spans(size, int(side / zoom), int(margin / zoom))) for size in (height, width))
    for (top, bottom), (first, last) in rows:
        for (left, right), (begin, end) in columns:
            yield (top, bottom, left, right), (first, last, begin, end)


def _spans(size: int, whole: int, margin: int) -> Iterator[tuple[tuple[int, int], tuple[int, int]]]:
    count = 1 if size <= whole else -(-size // (whole - 2 * margin))
    for number in range(count):
        begin, end = number * size // count, (number + 1) * size // count
        yield (max(begin - margin, 0), min(end + margin, size)), (begin, end)


def box_size(box: Box) -> tuple[int, int]:
    """Height and width of a box."""
    return box[1] - box[0], box[3] - box[2]


def nearest(extent: int, size: int) -> Array:
    """The pixel of ``size`` zoomed ones that is nearest to each of ``extent`` pixels."""
    return ((np.arange(extent) + 0.5) * size / extent).astype(int).clip(0, size - 1)


def zoomed(image: Array, zoom: float) -> Array:
    """Enlarge or reduce a picture (H, W, 3) float32 in [0, 1]."""
    if zoom == 1:
        return image
    height, width = (max(1, round(zoom * size)) for size in image.shape[:2])
    method = Image.Resampling.BICUBIC if zoom > 1 else Image.Resampling.LANCZOS
    channels = [Image.fromarray(image[..., c]).resize((width, height), method) for c in range(3)]
    return np.clip(np.stack([np.asarray(channel) for channel in channels], 2), 0, 1)


@contextmanager
def giving_back() -> Iterator[None]:
    """Give the memory of pictures back to the system as soon as they are freed."""
    keep_memory(KEPT)
    give_memory_back()
    try:
        yield
    finally:
        keep_memory()


def on_threads(work: Callable[[Item], Result], items: Sequence[Item]) -> Iterator[Result]:
    """Yield the results of ``work`` in the order of the items, which as many threads as PyTorch has deal with at once.

    Each computes alone meanwhile; that is faster than to share the work of one item, which waits for its slowest part.
    """

    def done(item: Item) -> Result:
        result = work(item)
        give_memory_back()
        return result

    before = torch.get_num_threads()
    give_memory_back()
    torch.set_num_threads(1)
    try:
        with ThreadPoolExecutor(max(min(before, len(items)), 1)) as pool:
            yield from pool.map(done, items)
    finally:
        torch.set_num_threads(before)
