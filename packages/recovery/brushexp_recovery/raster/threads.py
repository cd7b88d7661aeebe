"""Process the tiles of a picture in several threads, and return freed memory to the system."""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import TypeVar

import torch

from brushexp.contracts.machine import give_memory_back, keep_memory

Progress = Callable[[float, str], None]  # shows the finished share of the work and its state in words
Item = TypeVar("Item")
Result = TypeVar("Result")

KEPT_ARRAY = 2**23  # bytes; larger freed arrays are returned to the system, because they would fragment memory


@contextmanager
def return_freed_memory() -> Iterator[None]:
    """Return the memory of large arrays to the system as soon as they are freed, within a ``with`` block."""
    keep_memory(KEPT_ARRAY)
    give_memory_back()
    try:
        yield
    finally:
        keep_memory()


def map_on_threads(work: Callable[[Item], Result], items: Sequence[Item]) -> Iterator[Result]:
    """Yield the result of ``work`` for each item, in order, using as many threads as PyTorch does.

    Each item is processed by one thread, which is faster than splitting an item and waiting for its slowest part.
    """

    def work_and_free(item: Item) -> Result:
        result = work(item)
        give_memory_back()
        return result

    before = torch.get_num_threads()
    give_memory_back()
    torch.set_num_threads(1)
    try:
        with ThreadPoolExecutor(max(min(before, len(items)), 1)) as pool:
            yield from pool.map(work_and_free, items)
    finally:
        torch.set_num_threads(before)
