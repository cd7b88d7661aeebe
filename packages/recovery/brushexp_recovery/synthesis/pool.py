"""A pool of paintings on disk, which a process of its own fills while a network learns from it."""

import os
import sys
from collections.abc import Collection, Sequence
from pathlib import Path

import numpy as np

from brushexp_recovery.raster.npz import write_npz
from brushexp_recovery.synthesis.paintings import KnownPainting, family_of, paint

NICENESS = 10  # the pool leaves the processor to the training


def fill_pool(
    parent: int,
    folder: Path,
    seed: int,
    numbers: Sequence[int],
    pictures: Sequence[str],
    left_out: Collection[str] = (),
) -> None:
    """Paint those of ``numbers`` that are not there yet, as long as the process ``parent`` lives.

    Paintings of the families of paint in ``left_out`` are not made.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for number in numbers:
        if os.getppid() != parent:  # the training is over, however it ended
            return
        path = folder / f"{number:06d}.npz"
        if not path.is_file() and family_of(seed, number) not in left_out:
            save_painting(path, paint(seed, number, pictures))


def save_painting(path: Path, painting: KnownPainting) -> None:
    """Write a painting whole or not at all."""
    write_npz(path, image=painting.image, labels=painting.labels, geometry=painting.geometry)


def load_painting(path: Path) -> KnownPainting:
    """Read a painting of the pool."""
    with np.load(path) as file:
        return KnownPainting(file["image"], file["labels"], file["geometry"])


def main(parent: str, folder: str, seed: str, left_out: str, first: str, end: str, step: str, *pictures: str) -> None:
    """Fill a pool, as a process of its own, with the paintings ``range(first, end, step)``.

    ``left_out`` names families of paint, with commas between.
    """
    import torch  # noqa: PLC0415

    from brushexp.contracts.runs import load_plugins  # noqa: PLC0415

    if hasattr(os, "nice"):  # Windows has no such function
        os.nice(NICENESS)
    torch.set_num_threads(1)
    load_plugins(Path("plugins"), warns=False)
    numbers = range(int(first), int(end), int(step))
    fill_pool(int(parent), Path(folder), int(seed), numbers, pictures, left_out.split(","))


if __name__ == "__main__":
    main(*sys.argv[1:])
