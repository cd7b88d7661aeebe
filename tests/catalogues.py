"""Helpers that make catalogues, damage them, and check how they are read."""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import torch
from refusals import refusal

from brushexp.errors import UserError
from brushexp.plugins.blend.base import Blend
from brushexp.plugins.blend.tiled import Tiled
from brushexp.plugins.color.rgb import Rgb
from brushexp.plugins.export.base import ExportJob
from brushexp.plugins.renderer.analytic import Analytic
from brushexp.plugins.renderer.base import Renderer
from brushexp.shading.light import UNLIT, Light
from brushexp.strokes.catalogue import FIELDS, Strokes
from brushexp.strokes.storage import Saved, load_catalogue
from brushexp.system.hdf5 import encode_fixed

CONFIG = "renderer: {_target_: brushexp.plugins.renderer.analytic.Analytic, soft: 1.5, taper: 0.0}\nimage: größe.png\n"


def catalogue(n: int = 7) -> Saved:
    """Make a catalogue of random strokes for a small painting."""
    torch.manual_seed(n)
    strokes = {name: field.nearest(torch.rand(field.shape(n)).clamp(min=0.01)) for name, field in FIELDS.items()}
    return Saved(Strokes(**strokes), torch.randperm(n).int(), (30, 50), torch.rand(3), "analytic", "", 3, CONFIG)


def job_of(
    strokes: Strokes, size: tuple[int, int], *, depth: torch.Tensor | None = None, renderer: Renderer | None = None,
    blend: Blend | None = None, light: Light = UNLIT, source: str = "a test", **saved: object,
) -> ExportJob:  # fmt: skip
    """Make an export job for strokes; unless ``depth`` is given, the first stroke lies at the bottom."""
    depth = torch.arange(len(strokes)) if depth is None else depth
    saved = {"background": torch.full((3,), 0.5), "renderer": "analytic"} | saved
    record = Saved(strokes, depth.int(), size, **saved)
    return ExportJob(record, (renderer or Analytic()).eval(), blend or Tiled(), Rgb(), light, source)


def changed(job: ExportJob, **fields: object) -> ExportJob:
    """Return a copy of a job with some fields of its catalogue replaced."""
    return replace(job, saved=replace(job.saved, **fields))


def assert_same(read: Saved, saved: Saved) -> None:
    """Assert that two catalogues are bit-for-bit identical."""
    for name in FIELDS:
        torch.testing.assert_close(getattr(read.strokes, name), getattr(saved.strokes, name), rtol=0, atol=0)
    torch.testing.assert_close(read.depth, saved.depth, rtol=0, atol=0)
    torch.testing.assert_close(read.background, saved.background, rtol=0, atol=0)
    for name in ("size", "renderer", "renderer_hash", "seed", "config"):
        assert getattr(read, name) == getattr(saved, name)


def refused(path: Path, read: Callable[[Path], object] = load_catalogue) -> str:
    """Return the message for a file that cannot be read, after checking that it is one line and names the file once."""
    message = refusal(read, path)
    assert str(path) in message
    assert f"{path}: {path}" not in message
    assert len(message) < 400 + len(str(path))
    return message


def refused_if_foreign(path: Path, refusal: Callable[[Path], str]) -> str:
    """Check that files that are not HDF5 are refused, and return the message for an HDF5 file with foreign contents."""
    for data in (b"", b"\x89PNG\r\n\x1a\n" + bytes(3000), b"x" * 5000):
        path.write_bytes(data)
        assert "not an HDF5 file" in refusal(path)
    with h5py.File(path, "w") as file:
        file["params"] = np.zeros((3, 10))
    return refusal(path)


def give_attribute(path: Path, name: str, value: object) -> None:
    """Set an attribute of an HDF5 file, or delete it if ``value`` is None."""
    with h5py.File(path, "a") as file:
        del file.attrs[name]
        if value is not None:
            file.attrs[name] = encode_fixed(value) if isinstance(value, str) else value


def spoil_every(path: Path, step: int, unchanged: Callable[[], None]) -> None:
    """Damage one byte at a time, every ``step`` bytes; each damaged file is refused or passes ``unchanged``."""
    data = path.read_bytes()
    for position in range(0, len(data), step):
        path.write_bytes(data[:position] + bytes([data[position] ^ 0x55]) + data[position + 1 :])
        with suppress(UserError):  # some bytes have no meaning
            unchanged()
