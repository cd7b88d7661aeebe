"""Read untrusted HDF5 files piece by piece; if a file is invalid, raise a UserError that says why."""

import zlib
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from brushexp.errors import UserError
from brushexp.system.reading import check_file, explaining, shorten_value

HDF5 = "v110"  # version of the format for writing, the first with checksums of everything except variable-length text
LARGEST_ATTRIBUTE = 2**22  # bytes of the largest attribute
LARGEST_CHUNK = 2**26  # bytes of the largest unpacked chunk: 16 pictures of 1024 x 1024
GZIP, SHUFFLE, CHECKSUM = 1, 2, 3  # allowed filters; for others, HDF5 would load libraries
INFLATION = 1032  # largest number of bytes that gzip unpacks from one byte
PLAIN = (h5py.h5t.INTEGER, h5py.h5t.FLOAT, h5py.h5t.STRING)
SPARE = 2**12  # largest number of bytes by which packing enlarges small data


def encode_fixed(text: str) -> np.ndarray:
    """Encode a string as a fixed-length HDF5 string."""
    encoded = text.encode()
    return np.array(encoded, h5py.string_dtype("utf-8", max(1, len(encoded))))


def open_hdf5(path: Path, cure: str, **options: Any) -> h5py.File:
    """Open an HDF5 file for reading; raise a UserError if it is not a readable HDF5 file."""
    check_file(path, cure)
    with explaining(path, cure):
        if not h5py.is_hdf5(path):
            raise UserError(f"not an HDF5 file; {cure}")
        return h5py.File(path, "r", **options)


def dataset_of(
    file: h5py.File, name: str, dtype: type, shape: tuple[int, ...] | None, most: int = 2**40
) -> h5py.Dataset:
    """Return a dataset after checking its type, shape and storage, without reading its numbers.

    If ``shape`` is None, the dataset must have one axis of at most ``most`` values.
    """
    if not isinstance(file.get(name, getlink=True), h5py.HardLink) or not isinstance(file[name], h5py.Dataset):
        raise UserError(f"has no dataset {name}: it is damaged or incomplete; get it again")
    dataset = file[name]
    if "unit" not in dataset.attrs:
        raise UserError(f"dataset {name} has no attribute unit: it is damaged or incomplete; get it again")
    if dataset.dtype != dtype:
        raise UserError(f"{name} has type {dataset.dtype}; {np.dtype(dtype)} is needed")
    if (shape is None and len(dataset.shape) != 1) or (shape is not None and dataset.shape != shape):
        raise UserError(f"{name} has shape {dataset.shape}; {shape or '(N,)'} is needed")
    if shape is None and dataset.shape[0] > most:
        raise UserError(f"{name} has {dataset.shape[0]} values; at most {most} are read")
    if dataset.is_virtual or dataset.external:
        raise UserError(f"{name} is in another file; copy its numbers into this one")
    _check_storage(name, dataset)
    return dataset


def _check_storage(name: str, dataset: h5py.Dataset) -> None:
    """Reject unsupported compression, oversized chunks, and data larger than the stored bytes could unpack to."""
    layout, held = dataset.id.get_create_plist(), dataset.id.get_storage_size()
    used = [layout.get_filter(k)[0] for k in range(layout.get_nfilters())]
    if not {GZIP, SHUFFLE, CHECKSUM}.issuperset(used) or used.count(GZIP) > 1:
        raise UserError(f"{name} has an unsupported compression; use gzip")
    if dataset.chunks is not None:
        unpacked = int(np.prod(dataset.chunks)) * dataset.dtype.itemsize
        sizes = [0]
        dataset.id.chunk_iter(lambda chunk: sizes.append(chunk.size))
        if unpacked > LARGEST_CHUNK or max(sizes) > 1.01 * unpacked + SPARE:
            raise UserError(
                f"{name} has chunks of {unpacked} bytes, more than {LARGEST_CHUNK} or than its data; get it again"
            )
    if dataset.nbytes > held * INFLATION + SPARE:
        raise UserError(f"{name} claims {dataset.nbytes} bytes but stores only {held}; get it again")


def numbers_of(dataset: h5py.Dataset) -> np.ndarray:
    """Read all numbers of a dataset after checking every chunk with `check_chunk`."""
    offsets: list[tuple[int, ...]] = []
    if dataset.chunks is not None:
        dataset.id.chunk_iter(lambda chunk: offsets.append(chunk.chunk_offset))
    for offset in offsets:
        check_chunk(dataset, offset)
    return np.asarray(dataset[...])


def check_chunk(dataset: h5py.Dataset, offset: tuple[int, ...]) -> None:
    """Reject the chunk at ``offset`` if it unpacks to more than its declared size; HDF5 would allocate all of it."""
    layout = dataset.id.get_create_plist()
    kinds = [layout.get_filter(k)[0] for k in range(layout.get_nfilters())]
    skipped, packed = dataset.id.read_direct_chunk(offset)
    if GZIP not in kinds or skipped & 1 << kinds.index(GZIP):
        return
    size = int(np.prod(dataset.chunks)) * dataset.dtype.itemsize
    if len(zlib.decompressobj().decompress(packed, size + SPARE)) >= size + SPARE:
        raise UserError(
            f"{dataset.name[1:]} has a chunk that unpacks to more than its stated {size} bytes; get it again"
        )


def text_of(file: h5py.File, name: str) -> str:
    """Return the text attribute called ``name``."""
    return str(attribute_of(file, name, str, "text"))


def whole_number_of(file: h5py.File, name: str) -> int:
    """Return the integer attribute called ``name``."""
    return int(attribute_of(file, name, np.integer, "a whole number"))


def attribute_of(file: h5py.File, name: str, kind: type = object, words: str = "") -> Any:
    """Return an attribute of type ``kind``, which messages call ``words``; bytes are decoded as text."""
    if name not in file.attrs:
        raise UserError(f"has no attribute {name}: it is damaged or incomplete; get it again")
    stored = file.attrs.get_id(name)
    dtype = stored.get_type()
    if dtype.get_class() not in PLAIN or (isinstance(dtype, h5py.h5t.TypeStringID) and dtype.is_variable_str()):
        raise UserError(f"attribute {name} has no fixed length, so damage can hang HDF5; write it as numpy.bytes_(...)")
    if stored.get_storage_size() > LARGEST_ATTRIBUTE:
        raise UserError(f"attribute {name} has more than {LARGEST_ATTRIBUTE} bytes; get it again")
    value = file.attrs[name]
    value = value.decode() if isinstance(value, bytes) else value
    if not isinstance(value, kind):
        raise UserError(f"attribute {name} is {shorten_value(repr(value))}; {words} is needed")
    return value
