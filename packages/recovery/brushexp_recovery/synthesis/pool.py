"""Fill a pool of paintings on disk in a separate process while a network learns from it."""

import os
import sys
from collections.abc import Collection, Sequence
from pathlib import Path

import numpy as np

from brushexp_recovery.raster.npz import write_npz
from brushexp_recovery.synthesis.paintings import KnownPainting, family_of, paint

NICENESS = 10  # gives the training priority


def fill_pool(
    parent: int,
    folder: Path,
    seed: int,
    numbers: Sequence[int],
    pictures: Sequence[str],
    families: Collection[str] = (),
) -> None:
    """Make the paintings in ``numbers`` that the pool lacks, as long as the process ``parent`` is alive.

    If ``families`` are given, about half of all paintings have a paint family; of these, only the paintings of the
    given families are made. Otherwise no painting has a family.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for number in numbers:
        if os.getppid() != parent:  # the training has ended
            return
        path = path_of(folder, seed, number, families)
        if is_made(seed, number, families) and not path.is_file():
            save_painting(path, paint(seed, number, pictures, family_among(seed, number, families)))


def family_among(seed: int, number: int, families: Collection[str]) -> str | None:
    """Return the paint family of painting ``number`` in a pool with ``families``, or None if it has no family."""
    return family_of(seed, number) if families else None


def is_made(seed: int, number: int, families: Collection[str]) -> bool:
    """Check whether a pool with ``families`` includes painting ``number``."""
    family = family_among(seed, number, families)
    return family is None or family in families


def path_of(folder: Path, seed: int, number: int, families: Collection[str]) -> Path:
    """Return the path of painting ``number``, which includes the family, so that all pools can share a folder."""
    family = family_among(seed, number, families)
    return folder / f"{number:06d}{f'-{family}' if family else ''}.npz"


def save_painting(path: Path, painting: KnownPainting) -> None:
    """Write a painting to a file atomically."""
    write_npz(path, image=painting.image, labels=painting.labels, geometry=painting.geometry)


def load_painting(path: Path) -> KnownPainting:
    """Read a painting from a file of the pool."""
    with np.load(path) as file:
        return KnownPainting(file["image"], file["labels"], file["geometry"])


def main(parent: str, folder: str, seed: str, families: str, first: str, end: str, step: str, *pictures: str) -> None:
    """Fill a pool with the paintings ``range(first, end, step)``; this is the entry point of a separate process.

    ``families`` is a comma-separated list of paint families; an empty string means none.
    """
    import torch  # noqa: PLC0415

    from brushexp.contracts.runs import load_plugins  # noqa: PLC0415

    if hasattr(os, "nice"):  # missing on Windows
        os.nice(NICENESS)
    torch.set_num_threads(1)
    load_plugins(Path("plugins"), warns=False)
    numbers = range(int(first), int(end), int(step))
    fill_pool(int(parent), Path(folder), int(seed), numbers, pictures, families.split(",") if families else ())


if __name__ == "__main__":
    main(*sys.argv[1:])
