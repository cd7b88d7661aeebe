"""``catalogue.h5``: a finished catalogue on disk, with all that is needed to render it again.

One float32 dataset per field of `Strokes`, ``depth`` (int32, 0 = bottom), and attributes for the rest of `Saved`.
Everything in the file is covered by checksums of HDF5: it has them since format 1.10, but not for texts of variable
length, in which one wrong byte can send the HDF5 library into an endless loop.
"""

import io
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import torch
import yaml  # type: ignore[import-untyped,unused-ignore]
from torch import Tensor

from brushexp.errors import UserError
from brushexp.files import write_bytes
from brushexp.strokes.catalogue import FIELDS, Strokes, check_strokes

FORMAT = "brushexp catalogue"
VERSION = 1  # raise it whenever a file of the new kind would mislead an older reader
HDF5 = "v110"
LARGEST_SIDE = 1_000_000  # pixels
MOST_STROKES = 100_000_000
DEPTH_UNIT = "rank, 0 is the bottom stroke"


@dataclass(frozen=True)
class Saved:
    """A finished catalogue and where it came from.

    Attributes:
        strokes: N strokes, float32.
        depth: (N,) int32 ranks, a permutation of 0 to N - 1; 0 is the bottom stroke.
        size: height and width of the canvas, pixels.
        background: (3,) RGB in [0, 1].
        renderer: name of the renderer plugin.
        renderer_hash: of its checkpoint; empty when it has none.
        seed: of the run.
        config: the resolved config of the run as YAML. It is text from a file: show it, never instantiate from it.
    """

    strokes: Strokes
    depth: Tensor
    size: tuple[int, int]
    background: Tensor
    renderer: str
    renderer_hash: str
    seed: int
    config: str


def save_catalogue(path: Path, saved: Saved) -> None:
    """Write a catalogue whole or not at all; same catalogue, same bytes.

    Raises:
        UserError: if `load_catalogue` would refuse it, or the file cannot be written.
    """
    strokes = saved.strokes.map(lambda value: value.detach().to("cpu", torch.float32))
    check_strokes(strokes)
    _check(strokes, saved.depth, saved.size, saved.background, saved.config)
    memory = io.BytesIO()  # h5py does not say why writing to a file failed
    with h5py.File(memory, "w", libver=(HDF5, HDF5)) as file:
        for name, value in strokes.items():
            _put(file, name, value.numpy(), FIELDS[name].unit)
        _put(file, "depth", saved.depth.detach().cpu().numpy().astype(np.int32), DEPTH_UNIT)
        file.attrs.update(
            format=_fixed(FORMAT),
            format_version=VERSION,
            height=saved.size[0],
            width=saved.size[1],
            background=saved.background.detach().to("cpu", torch.float32).numpy(),
            renderer=_fixed(saved.renderer),
            renderer_hash=_fixed(saved.renderer_hash),
            seed=saved.seed,
            config=_fixed(saved.config),
        )
    write_bytes(path, memory.getvalue())


def load_catalogue(path: Path) -> Saved:
    """Read a catalogue and check all of it.

    Raises:
        UserError: says what is wrong with the file.
    """
    if path.is_dir():
        raise UserError(f"{path} is a folder; give the file in it, catalogue={path / 'catalogue.h5'}")
    if not path.exists():
        raise UserError(f"there is no file {path}; give the catalogue.h5 of a finished run, catalogue=...")
    try:
        path.open("rb").close()
        if not h5py.is_hdf5(path):
            raise UserError("not an HDF5 file; give the catalogue.h5 of a finished run, catalogue=...")
        with h5py.File(path, "r") as file:
            return _read(file)
    except UserError as error:
        raise UserError(f"{path}: {error}") from error
    except (OSError, RuntimeError, ValueError, KeyError, TypeError) as error:  # h5py raises all of these
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error).partition("\n")[0]
        raise UserError(f"{path} is damaged or cut short ({reason}); save it again or give another one") from error


def _read(file: h5py.File) -> Saved:
    _check_format(file)
    count = _dataset(file, "depth", np.int32, None).shape[0]
    if count > MOST_STROKES:
        raise UserError(f"{count} strokes; at most {MOST_STROKES} can be read")
    values = {}
    for name, field in FIELDS.items():  # every header before any number, so that nothing huge is read in vain
        values[name] = _dataset(file, name, np.float32, field.shape(count))
    strokes = Strokes(**{name: torch.from_numpy(values[name][...]) for name in FIELDS})
    check_strokes(strokes)
    saved = Saved(
        strokes=strokes,
        depth=torch.from_numpy(file["depth"][...]),
        size=(_whole_number(file, "height"), _whole_number(file, "width")),
        background=_numbers(file, "background"),
        renderer=_text(file, "renderer"),
        renderer_hash=_text(file, "renderer_hash"),
        seed=_whole_number(file, "seed"),
        config=_text(file, "config"),
    )
    _check(saved.strokes, saved.depth, saved.size, saved.background, saved.config)
    return saved


def _check_format(file: h5py.File) -> None:
    if "format" not in file.attrs or _text(file, "format") != FORMAT:
        raise UserError(f"an HDF5 file, but not a {FORMAT}; give the catalogue.h5 of a finished run, catalogue=...")
    version = _whole_number(file, "format_version")
    if version > VERSION:
        raise UserError(
            f"was written by a newer version of brushexp (format {version}; this one reads {VERSION}); update brushexp"
        )
    if version < 1:
        raise UserError(f"format_version is {version}; {VERSION} is needed")


def _check(strokes: Strokes, depth: Tensor, size: tuple[int, int], background: Tensor, config: str) -> None:
    """What `check_strokes` does not check."""
    count = len(strokes)
    ranks = depth.detach().cpu().sort().values
    if tuple(depth.shape) != (count,) or not torch.equal(ranks, torch.arange(count, dtype=ranks.dtype)):
        raise UserError(f"depth is not an order of the strokes; each rank from 0 to {count - 1} is needed once")
    if not all(1 <= side <= LARGEST_SIDE for side in size):
        raise UserError(f"the canvas is {size[0]} x {size[1]} pixels; each side must lie in [1, {LARGEST_SIDE}]")
    if tuple(background.shape) != (3,) or not bool(((background >= 0) & (background <= 1)).all()):
        raise UserError(f"background is {background.tolist()}; three numbers in [0, 1] are needed")
    _check_yaml(config)


def _check_yaml(text: str) -> None:
    """Parse without constructing anything; refuse aliases, which can make a short text endless."""
    try:
        events = list(yaml.parse(text, yaml.SafeLoader))
    except yaml.YAMLError as error:
        raise UserError(f"config is not YAML ({' '.join(str(error).split())})") from error
    if text.strip() and not any(isinstance(event, yaml.MappingStartEvent) for event in events[2:3]):
        raise UserError("config is not a YAML mapping of keys to values")
    if any(isinstance(event, yaml.AliasEvent) for event in events):
        raise UserError("config contains a YAML alias (*name), which no config of brushexp does")


def _put(file: h5py.File, name: str, value: np.ndarray, unit: str) -> None:
    packed = {"compression": "gzip", "shuffle": True, "fletcher32": True} if value.size else {}
    file.create_dataset(name, data=value, **packed).attrs["unit"] = _fixed(unit)


def _fixed(text: str) -> np.ndarray:
    """The text as HDF5 keeps it inside an object: with a length that is known."""
    encoded = text.encode()
    return np.array(encoded, h5py.string_dtype("utf-8", max(1, len(encoded))))


def _dataset(file: h5py.File, name: str, dtype: type, shape: tuple[int, ...] | None) -> h5py.Dataset:
    """The dataset, if it is what the format says; its numbers are not read yet. Without a shape: one axis."""
    dataset = file.get(name)
    if not isinstance(dataset, h5py.Dataset):
        raise UserError(f"has no dataset {name}; it is damaged or not complete")
    if "unit" not in dataset.attrs:
        raise UserError(f"dataset {name} has no attribute unit; it is damaged or not complete")
    if dataset.dtype != dtype:
        raise UserError(f"{name} has type {dataset.dtype}; {np.dtype(dtype)} is needed")
    if (shape is None and len(dataset.shape) != 1) or (shape is not None and dataset.shape != shape):
        raise UserError(f"{name} has shape {dataset.shape}; {shape or '(N,)'} is needed")
    return dataset


def _text(file: h5py.File, name: str) -> str:
    value = _attribute(file, name)
    if isinstance(value, bytes):
        value = value.decode()
    if not isinstance(value, str):
        raise UserError(f"attribute {name} is {value!r}; text is needed")
    return value


def _whole_number(file: h5py.File, name: str) -> int:
    value = _attribute(file, name)
    if not isinstance(value, np.integer):
        raise UserError(f"attribute {name} is {value!r}; a whole number is needed")
    return int(value)


def _numbers(file: h5py.File, name: str) -> Tensor:
    value = np.asarray(_attribute(file, name))
    if value.dtype.kind not in "fiu":
        raise UserError(f"attribute {name} is {value!r}; numbers are needed")
    return torch.from_numpy(value.astype(np.float32))


def _attribute(file: h5py.File, name: str) -> Any:
    if name not in file.attrs:
        raise UserError(f"has no attribute {name}; it is damaged or not complete")
    return file.attrs[name]
