"""Store recovered strokes in a catalogue.h5 with an additional group for confidences and visible regions."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from brushexp.contracts import UserError
from brushexp.contracts.files import HDF5, dataset_of, encode_fixed, explaining, numbers_of, open_hdf5, replacing
from brushexp.contracts.strokes import CATALOGUE_NAME, Saved, load_catalogue, save_catalogue

Array = NDArray[Any]

GROUP = "recovered"
UNITS = {
    "confidence": "chance that such a stroke was painted, 0 to 1",
    "labels": "row of the stroke that is seen, -1 where none was recovered",
    "meetings": "rows of two strokes that meet",
    "chance_above": "chance that the second of two strokes lies above the first, 0 to 1",
    "ground": "1 where no stroke was recovered and the ground looks bare",
}


@dataclass(frozen=True)
class Recovered:
    """N strokes recovered from a picture (H, W): a catalogue, confidences and visible regions."""

    saved: Saved
    confidence: Array  # (N,) float32 in [0, 1], for each row of the catalogue
    labels: Array  # (H, W) int32, row of the visible stroke; -1 on bare ground and where no stroke was found
    meetings: Array = field(default_factory=lambda: np.empty((0, 2), np.int32))  # (P, 2) rows of strokes that meet
    chance_above: Array = field(default_factory=lambda: np.empty(0, np.float32))  # (P,) of the second being above
    ground: Array | None = None  # (H, W) bool, whether no stroke was found and the ground looks bare; None if unknown


def write_recovered(path: Path, recovered: Recovered) -> None:
    """Write recovered strokes atomically as a catalogue with an additional ``recovered`` group."""
    with replacing(path) as temporary:
        save_catalogue(temporary, recovered.saved)
        with h5py.File(temporary, "a", libver=(HDF5, HDF5)) as file:
            group = file.create_group(GROUP)
            values = {
                "confidence": recovered.confidence.astype(np.float32),
                "labels": recovered.labels.astype(np.int32),
                "meetings": recovered.meetings.astype(np.int32),
                "chance_above": recovered.chance_above.astype(np.float32),
            }
            if recovered.ground is not None:
                values["ground"] = recovered.ground.astype(np.uint8)
            for name, value in values.items():
                packed = {"compression": "gzip", "shuffle": True, "fletcher32": True} if value.size else {}
                group.create_dataset(name, data=value, **packed).attrs["unit"] = encode_fixed(UNITS[name])


def read_recovered(path: Path) -> Recovered:
    """Read a file written by `write_recovered`, given its path or folder; raise UserError for any other file."""
    saved = load_catalogue(path)
    path, cure = path / CATALOGUE_NAME if path.is_dir() else path, "give the catalogue.h5 of task=recover"
    with open_hdf5(path, cure) as file, explaining(path, cure):
        if GROUP not in file:
            raise UserError(f"strokes that were painted, not recovered; {cure}")
        confidence = numbers_of(dataset_of(file, f"{GROUP}/confidence", np.float32, (len(saved.strokes),)))
        labels = numbers_of(dataset_of(file, f"{GROUP}/labels", np.int32, saved.size))
        meetings, above = np.empty((0, 2), np.int32), np.empty(0, np.float32)
        if f"{GROUP}/meetings" in file:  # missing in files of earlier versions
            above = numbers_of(dataset_of(file, f"{GROUP}/chance_above", np.float32, None))
            meetings = numbers_of(dataset_of(file, f"{GROUP}/meetings", np.int32, (len(above), 2)))
        ground = None
        if f"{GROUP}/ground" in file:
            ground = numbers_of(dataset_of(file, f"{GROUP}/ground", np.uint8, saved.size)) > 0
    if not ((confidence >= 0) & (confidence <= 1)).all():
        raise UserError(f"{path}: confidence is not between 0 and 1; {cure}")
    if labels.min(initial=-1) < -1 or labels.max(initial=-1) >= len(saved.strokes):
        raise UserError(f"{path}: labels name strokes that do not exist; {cure}")
    if not ((above >= 0) & (above <= 1)).all() or not ((meetings >= 0) & (meetings < len(saved.strokes))).all():
        raise UserError(f"{path}: meetings name strokes that do not exist, or probabilities beyond 0 and 1; {cure}")
    return Recovered(saved, confidence, labels, meetings, above, ground)
