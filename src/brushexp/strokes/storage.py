"""Save and load finished catalogues as HDF5, with everything needed to redraw them (docs/formats.md).

Packages may add catalogue formats, each with its own file extension. Strings have a fixed length: HDF5 computes no
checksums of variable-length strings, and one wrong byte in such a string can cause an infinite loop.
"""

import io
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import torch

from brushexp.errors import UserError
from brushexp.strokes.catalogue import FIELDS, LATER_FIELDS, Strokes
from brushexp.strokes.saved import (
    BRUSH_UNIT,
    DEPTH_UNIT,
    FORMAT,
    VERSION,
    Saved,
    alpha_of,
    fields_in,
    parse,
    png_of,
)
from brushexp.system.files import write_bytes
from brushexp.system.hdf5 import (
    HDF5,
    attribute_of,
    dataset_of,
    encode_fixed,
    numbers_of,
    open_hdf5,
    text_of,
    whole_number_of,
)
from brushexp.system.published import CATALOGUES, entry_points_of
from brushexp.system.reading import check_file, check_format_version, explaining, read_text, shorten_value
from brushexp.system.spellings import find_path

__all__ = ["Saved", "load_catalogue", "save_catalogue"]
CATALOGUE_NAME = "catalogue.h5"  # file name in the folder of a run
SHIPPED = Path(__file__).with_name("catalogues")
MOST_STROKES = 10_000_000  # largest number of strokes in a file, 0.7 GB
ALPHA_UNIT = "bytes of a grey PNG, stretched over the canvas: 255 where the painting is, 0 where nothing is"
LARGEST_TEXT = 2**29  # largest number of bytes of a JSON catalogue, for two million strokes


def save_catalogue(path: Path, saved: Saved) -> None:
    """Write a catalogue atomically and deterministically; raise a UserError if it could not be loaded again."""
    strokes = saved.strokes.map(lambda value: value.detach().to("cpu", torch.float32))
    replace(saved, strokes=strokes).check()
    memory = io.BytesIO()  # in memory, because h5py does not explain failures to write a file
    with h5py.File(memory, "w", libver=(HDF5, HDF5)) as file:
        names, version = fields_in(strokes)
        for name in names:
            _put(file, name, getattr(strokes, name).numpy(), FIELDS[name].unit)
        _put(file, "brush", strokes.brush.numpy().astype(np.int32), BRUSH_UNIT)
        _put(file, "depth", saved.depth.detach().cpu().numpy().astype(np.int32), DEPTH_UNIT)
        if saved.alpha is not None:
            _put(file, "alpha", np.frombuffer(png_of(saved.alpha), np.uint8), ALPHA_UNIT)
        (height, width), background = saved.size, saved.background.detach().to("cpu", torch.float32).numpy()
        file.attrs.update(format=encode_fixed(FORMAT), format_version=version, height=height, width=width)
        file.attrs.update(background=background, renderer=encode_fixed(saved.renderer))
        file.attrs.update(
            renderer_hash=encode_fixed(saved.renderer_hash), seed=saved.seed, config=encode_fixed(saved.config)
        )
    write_bytes(path, memory.getvalue())


def _put(file: h5py.File, name: str, value: np.ndarray, unit: str) -> None:
    options = {"compression": "gzip", "shuffle": True, "fletcher32": True} if value.size else {}
    file.create_dataset(name, data=value, **options).attrs["unit"] = encode_fixed(unit)


def load_catalogue(path: Path, option: str = "catalogue") -> Saved:
    """Load and check a catalogue from its file, a run's folder, or the name of a shipped catalogue.

    ``option`` is the key of the path in error messages. An invalid catalogue raises a UserError.
    """
    if str(path).isidentifier() and not path.exists() and (SHIPPED / f"{path}.h5").is_file():
        path = SHIPPED / f"{path}.h5"
    path = find_path(path)
    cure, again = f"give the folder of a finished run, {option}=outputs/x", "save it again or give another one"
    if path.is_dir():  # the folder of a run stands for its catalogue
        path = path / CATALOGUE_NAME
        if not path.exists() and (others := sorted(path.parent.glob("*/*.h5"))):  # a sweep or a film
            cure = f"give one of the folders below it, {option}={others[0]}"
    if path.suffix.lower() == ".json":
        text = read_text(path, cure, LARGEST_TEXT)
        with explaining(path, again):
            return parse(text).check()
    if (point := entry_points_of(CATALOGUES).get(path.suffix.lower().removeprefix("."))) is not None:
        check_file(path, cure, LARGEST_TEXT)
        with explaining(path, again):
            saved: Saved = point.load()(path.read_bytes())
            return saved.check()
    with open_hdf5(path, cure) as file, explaining(path, again):
        return _read(file, cure).check()


def _read(file: h5py.File, cure: str) -> Saved:
    if "format" not in file.attrs or text_of(file, "format") != FORMAT:
        raise UserError(f"an HDF5 file, but not a {FORMAT}; {cure}")
    check_format_version(version := whole_number_of(file, "format_version"), VERSION)
    depth = dataset_of(file, "depth", np.int32, None, MOST_STROKES)
    count = depth.shape[0]
    known = {name: FIELDS[name] for name in FIELDS if LATER_FIELDS.get(name, 0) <= version}
    values = {name: dataset_of(file, name, np.float32, field.shape(count)) for name, field in known.items()}
    background = np.asarray(attribute_of(file, "background"))
    if background.dtype.kind not in "fiu":
        raise UserError(f"attribute background is {shorten_value(repr(background))}, not numbers")
    fields = {name: torch.from_numpy(numbers_of(value)) for name, value in values.items()}
    brush = torch.arange(count)  # brushes of files of version 1, which store none
    if "brush" in file:
        brush = torch.from_numpy(numbers_of(dataset_of(file, "brush", np.int32, (count,)))).long()
    alpha = None
    if "alpha" in file:
        alpha = alpha_of(numbers_of(dataset_of(file, "alpha", np.uint8, None, LARGEST_TEXT)).tobytes())
    height, width, seed = (whole_number_of(file, name) for name in ("height", "width", "seed"))
    texts = {name: text_of(file, name) for name in ("renderer", "renderer_hash", "config")}
    strokes, ranks = Strokes(**fields, brush=brush), torch.from_numpy(numbers_of(depth))
    bare = torch.from_numpy(background.astype(np.float32))
    return Saved(strokes, ranks, (height, width), bare, seed=seed, alpha=alpha, **texts)
