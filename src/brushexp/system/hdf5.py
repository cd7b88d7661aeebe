"""Parts of HDF5 files that are read by programs which trust nobody: every function says what is wrong with the file."""

from typing import Any

import h5py
import numpy as np

from brushexp.errors import UserError

HDF5 = "v110"  # of the library whose format is written: the first with checksums of everything but free text


def fixed(text: str) -> np.ndarray:
    """The text as HDF5 keeps it inside an object: with a length that is known."""
    encoded = text.encode()
    return np.array(encoded, h5py.string_dtype("utf-8", max(1, len(encoded))))


def dataset_of(file: h5py.File, name: str, dtype: type, shape: tuple[int, ...] | None) -> h5py.Dataset:
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


def text_of(file: h5py.File, name: str) -> str:
    """The attribute, if it is text."""
    return str(attribute_of(file, name, str, "text"))


def whole_number_of(file: h5py.File, name: str) -> int:
    """The attribute, if it is a whole number."""
    return int(attribute_of(file, name, np.integer, "a whole number"))


def attribute_of(file: h5py.File, name: str, kind: type = object, words: str = "") -> Any:
    """The attribute, if it is of a kind, which is called ``words``; bytes count as text."""
    if name not in file.attrs:
        raise UserError(f"has no attribute {name}; it is damaged or not complete")
    value = file.attrs[name]
    value = value.decode() if isinstance(value, bytes) else value
    if not isinstance(value, kind):
        raise UserError(f"attribute {name} is {value!r}; {words} is needed")
    return value
