"""Write and read files of encoded strokes, ``strokes.bits``; docs/formats.md specifies the format."""

import json
import struct
import zlib
from typing import Any

import numpy as np
import torch
from omegaconf import OmegaConf

from brushexp.contracts import UserError
from brushexp.contracts.files import check_format_version, json_of
from brushexp.contracts.strokes import Saved, alpha_of, config_of, png_of
from brushexp_coding import entropy
from brushexp_coding.residuals import (
    Prediction,
    nearest_before,
    residuals_of,
    restore_numbers,
    rgb_to_ycocg,
    sources,
    ycocg_to_rgb,
)
from brushexp_coding.rounding import MAX_COARSENESS, WINDOW_COLUMNS, Column, Rounded
from brushexp_coding.streams import Reader, Writer

MAGIC = b"BXST"
VERSION = 1
HEAD = struct.Struct("<4sBI")  # magic number, version, checksum of the rest
SIZES = struct.Struct("<IIIIHHHHI")  # strokes, height, width, columns, background, bytes of settings and of alpha
HAS_WINDOWS, HAS_BRUSHES = 1 << 30, 1 << 31  # flags; the lower bits mark the columns that are not 0 for all strokes
MOST_STROKES = 1_000_000
LARGEST_SETTINGS = 2**16  # bytes, uncompressed
KEPT_SETTINGS = ("renderer", "color", "paper", "light")  # settings that determine how a painting is drawn
LEVELS = 65_535  # maximum level of a background channel
GROUPS = (  # columns that share a prediction, in coding order
    (Column.MIDDLE_X, Column.MIDDLE_Y),
    (Column.THICKNESS,),
    (Column.CHORD_X, Column.CHORD_Y),
    (Column.BEND_X, Column.BEND_Y),
    (Column.SOFTNESS,),
    (Column.OPACITY,),
    (Column.RED, Column.GREEN, Column.BLUE),
    (Column.WIDENING,),
    (Column.DRIFT_RED, Column.DRIFT_GREEN, Column.DRIFT_BLUE),
    WINDOW_COLUMNS,
)
FEWEST_TO_CLASS = 400  # minimum number of strokes at which distributions depend on the coarseness of a stroke
TRIPLE = 3  # number of columns of a colour
PLACED_BY = (Prediction.NOTHING, Prediction.LAST)  # the nearest stroke is unknown until all centres are decoded
TYPICAL = (  # typical settings, the preset dictionary of their compression
    b'{"renderer": "analytic", "renderer_hash": "", "seed": 0, "config": "renderer:\\n  _target_: renderer/analytic\\n'
    b"  soft: 2.0\\n  taper: 0.0\\ncolor:\\n  _target_: color/rgb\\npaper:\\n  _target_: paper/smooth\\nlight:\\n"
    b'  depth: 0.0\\n  azimuth: 135.0\\n  elevation: 45.0\\n  gloss: 0.0\\n"}'
)


def file_of(rounded: Rounded, saved: Saved) -> bytes:
    """Return the file contents for rounded strokes, with the canvas and the settings of the painting ``saved``."""
    if len(rounded) > MOST_STROKES:
        raise UserError(f"{len(rounded)} strokes are more than the {MOST_STROKES} that to=bits can hold; use to=json")
    settings = _packed_settings(saved)
    alpha = b"" if saved.alpha is None else png_of(saved.alpha)
    present = [bool(rounded.numbers[:, column].any()) for column in range(rounded.numbers.shape[1])]
    mask = sum(1 << column for column, is_there in enumerate(present) if is_there)
    mask |= HAS_WINDOWS * rounded.windows | HAS_BRUSHES * (rounded.brushes is not None)
    background = np.rint(saved.background.double().numpy() * LEVELS).astype(int).tolist()
    body = SIZES.pack(len(rounded), *saved.size, mask, *background, len(settings), len(alpha)) + settings + alpha
    body += bytes(rounded.rungs[present].astype(np.uint8)) + _encode(rounded, present)
    return HEAD.pack(MAGIC, VERSION, zlib.crc32(body)) + body


def read_bits(data: bytes) -> Saved:
    """Decode the contents of a file as a painting; raise UserError if they are not valid."""
    rounded, saved = read_rounded(data)
    strokes = rounded.strokes()
    return Saved(strokes, torch.arange(len(strokes), dtype=torch.int32), *saved[:2], **saved[2])


def read_rounded(data: bytes) -> tuple[Rounded, tuple[tuple[int, int], torch.Tensor, dict[str, Any]]]:
    """Decode the rounded strokes in a file, the size and background of its canvas, and its settings."""
    magic, version, checksum = HEAD.unpack_from(data) if len(data) >= HEAD.size else (b"", 0, 0)
    if magic != MAGIC:
        raise UserError("not a file of coded strokes; give a strokes.bits of task=export to=bits")
    check_format_version(version, VERSION)
    body = data[HEAD.size :]
    if zlib.crc32(body) != checksum:
        raise UserError("damaged or cut short: its checksum differs; export it again with to=bits")
    count, height, width, mask, *background, packed, alpha = SIZES.unpack_from(body)
    if count > MOST_STROKES:
        raise UserError(f"has {count} strokes, but at most {MOST_STROKES} can be read")
    at = SIZES.size + packed
    settings = _unpacked_settings(body[SIZES.size : at])
    settings["alpha"] = alpha_of(body[at : at + alpha]) if alpha else None
    columns = len(Column) if mask & HAS_WINDOWS else len(Column) - len(WINDOW_COLUMNS)
    present = [bool(mask >> column & 1) for column in range(columns)]
    rungs = np.zeros(columns, np.int64)
    at += alpha
    rungs[present] = np.frombuffer(body, np.uint8, sum(present), at)
    rounded = _decode(body[at + sum(present) :], count, rungs, present, mask)
    bare = (torch.tensor(background, dtype=torch.float64) / LEVELS).float()
    return rounded, ((height, width), bare, settings)


def _encode(rounded: Rounded, present: list[bool]) -> bytes:
    """Encode the coarseness, the brushes and the columns, using the best prediction for each group of columns."""
    writer, alike = Writer(), np.zeros(len(rounded), np.int64)
    for kind in rounded.coarseness.T:
        writer.write_column(kind, alike)
    if rounded.brushes is not None:
        writer.write_column(rounded.brushes, alike)
    octaves, classes = rounded.octaves, _classes(rounded.coarseness)
    nearest = nearest_before(rounded.middles)
    for group in _groups(present):
        numbers, bits = rounded.numbers[:, group], np.inf
        for prediction in PLACED_BY if group[0] in GROUPS[0] else Prediction:
            residuals = residuals_of(numbers, octaves[:, group], sources(prediction, len(rounded), nearest))
            for turn in (False, True) if len(group) == TRIPLE else (False,):
                trial = Writer()
                trial.write(prediction)
                trial.write(turn)
                for column in (rgb_to_ycocg(residuals) if turn else residuals).T:
                    trial.write_column(column, classes)
                size = 8 * len(trial.described) + sum(entropy.bits_of(*coded) for coded in trial.groups)
                if size < bits:
                    best, bits = trial, size
        writer.described += best.described
        writer.groups += best.groups
    return writer.to_bytes()


def _decode(data: bytes, count: int, rungs: np.ndarray, present: list[bool], mask: int) -> Rounded:
    """Decode the output of `_encode`."""
    reader, alike = Reader(data), np.zeros(count, np.int64)
    coarseness = np.stack([reader.read_column(alike) for _ in range(2)], axis=1)
    if (np.abs(coarseness) > MAX_COARSENESS).any():
        raise ValueError("a stroke is too coarse")
    brushes = reader.read_column(alike) if mask & HAS_BRUSHES else None
    rounded = Rounded(np.zeros((count, len(rungs)), np.int64), coarseness, rungs, bool(mask & HAS_WINDOWS), brushes)
    octaves, classes, nearest = rounded.octaves, _classes(coarseness), None
    for group in _groups(present):
        if nearest is None and group[0] not in GROUPS[0]:
            nearest = nearest_before(rounded.middles)
        prediction, turn = Prediction(reader.read()), reader.read()
        residuals = np.stack([reader.read_column(classes) for _ in group], axis=1)
        residuals = ycocg_to_rgb(residuals) if turn else residuals
        rounded.numbers[:, group] = restore_numbers(residuals, octaves[:, group], sources(prediction, count, nearest))
    return rounded


def _groups(present: list[bool]) -> list[list[Column]]:
    """List the columns in each group; omit columns that are 0 for all strokes, and groups without columns."""
    groups = ([column for column in group if column < len(present) and present[column]] for group in GROUPS)
    return [group for group in groups if group]


def _classes(coarseness: np.ndarray) -> np.ndarray:
    """Classify the rounding (N,) of each stroke's shape as finer than the median (0), equal (1) or coarser (2)."""
    if len(coarseness) < FEWEST_TO_CLASS:
        return np.zeros(len(coarseness), np.int64)
    return np.sign(coarseness[:, 0]) + 1


def _packed_settings(saved: Saved) -> bytes:
    """Pack the renderer's name, the hash of its weights, the seed, and the settings in `KEPT_SETTINGS`."""
    kept = {key: value for key, value in config_of(saved).items() if key in KEPT_SETTINGS}
    config = OmegaConf.to_yaml(OmegaConf.create(kept)) if kept else ""
    about = {"renderer": saved.renderer, "renderer_hash": saved.renderer_hash, "seed": saved.seed, "config": config}
    packer = zlib.compressobj(9, zlib.DEFLATED, -zlib.MAX_WBITS, zdict=TYPICAL)
    return packer.compress(json.dumps(about).encode()) + packer.flush()


def _unpacked_settings(packed: bytes) -> dict[str, Any]:
    text = zlib.decompressobj(-zlib.MAX_WBITS, zdict=TYPICAL).decompress(packed, LARGEST_SETTINGS)
    about = json_of(text.decode())
    kinds = {"renderer": str, "renderer_hash": str, "seed": int, "config": str}
    if not isinstance(about, dict) or {name: type(value) for name, value in about.items()} != kinds:
        raise ValueError("its settings have unexpected names or types")
    return about
