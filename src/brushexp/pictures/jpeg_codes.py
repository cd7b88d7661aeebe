"""Decode the Huffman codes of a baseline JPEG (ITU-T T.81) to detect damage, because the format has no checksum.

After a flipped bit, the codes often decode to too many or too few blocks. Each block also stores the difference between
its own mean and the mean of the previous block, so a wrong difference shifts all later blocks, often beyond the range
of 8-bit pixels.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from brushexp.compat.compiled import function, inline

START = b"\xff\xd8"
TABLES_OF_STEPS, TABLES_OF_CODES, RESTART, SCAN = 0xDB, 0xC4, 0xDD, 0xDA  # markers
BASELINE, OTHER_FRAMES = (0xC0, 0xC1), (0xC2, 0xC3, *range(0xC5, 0xC8), *range(0xC9, 0xCC), *range(0xCD, 0xD0))
END_OF_CODES = re.compile(rb"\xff[^\0\xd0-\xd7]", re.DOTALL)
BETWEEN_INTERVALS = re.compile(rb"\xff[\xd0-\xd7]")
BLOCK = 0x10  # class of codes for all numbers of a block except the first
LONGEST_CODE = 16  # bits
LONGEST_NUMBER = 11  # bits
PADDING = 4  # bytes read after the last code
DARKEST = -1024  # mean of a block of black pixels, -128, in the units of the format
LARGEST = 1280  # largest amplitude: a quarter more than 8-bit pixels have, because encoders may exceed white at edges
NUMBERS = 64  # numbers per block


@function
def fits(data, units, kinds, codes, steps):  # type: ignore[no-untyped-def]
    """Check whether padded data encode exactly ``units`` minimum coded units whose values are in the 8-bit range.

    The data end with `PADDING` extra bytes. ``kinds`` (B,) holds the component of each block in a unit. ``codes``
    (C, 2, 65536) has one table for the first coefficient of a block (DC) and one for the others (AC); a table maps the
    next 16 bits to 256 times the code length plus the symbol. ``steps`` (C, 64) are the quantisation steps of the
    coefficients.
    """
    means = np.zeros(len(steps), dtype=np.int64)
    at, end = 0, 8 * (len(data) - PADDING)  # bits
    for _ in range(units):
        for kind in kinds:
            k = 0
            while k < NUMBERS:
                code = codes[kind, min(k, 1), bits_at(data, at)]
                length, zeros, size = code >> 8, code >> 4 & 15, code & 15
                at += length
                if length == 0 or at > end:
                    return False
                if k and not size:
                    if zeros < 15:
                        break
                    k += 16
                    continue
                k += zeros
                if at + size > end or k >= NUMBERS or size > LONGEST_NUMBER:
                    return False
                value = bits_at(data, at) >> (LONGEST_CODE - size)
                if size and value < 1 << (size - 1):
                    value -= (1 << size) - 1
                at += size
                if k == 0:
                    means[kind] += value
                    value = means[kind]
                    if value * steps[kind, 0] < DARKEST - steps[kind, 0]:
                        return False
                if abs(value) * steps[kind, k] > LARGEST + steps[kind, k]:
                    return False
                k += 1
            if k > NUMBERS:
                return False
    return end - at < 8


@inline
def bits_at(data, at):  # type: ignore[no-untyped-def]
    """Return the 16 bits that start at bit ``at``."""
    byte = at >> 3
    three = np.int64(data[byte]) << 16 | np.int64(data[byte + 1]) << 8 | np.int64(data[byte + 2])
    return three >> (8 - (at & 7)) & 0xFFFF


@dataclass
class Header:
    """The header data that precede the codes in a JPEG."""

    steps: dict[int, np.ndarray] = field(default_factory=dict)  # (64,) quantisation steps by table number
    codes: dict[int, np.ndarray] = field(default_factory=dict)  # (65536,) codes by class plus table number
    restart: int = 0  # units per interval; 0 for all units
    size: tuple[int, int] = (0, 0)  # height and width in pixels
    components: list[tuple[int, int, int, int]] = field(default_factory=list)  # name, blocks across and down, table
    chosen: dict[int, int] = field(default_factory=dict)  # numbers of the tables of codes by component name
    end: int = 0  # byte at which the codes begin


def jpeg_fits(data: bytes) -> bool:
    """Check whether a JPEG's codes match its size; only baseline files with a single scan can fail this check."""
    try:
        if (header := _header(data)) is None:
            return True
        names = [name for name, *_ in header.components]
        shapes = [(across, down) for _, across, down, _ in header.components] if len(names) > 1 else [(1, 1)]
        across, down = (8 * max(sides) for sides in zip(*shapes, strict=True))
        units = -(-header.size[1] // across) * -(-header.size[0] // down)
        kinds = np.repeat(np.arange(len(names)), [across * down for across, down in shapes])
        steps = np.stack([header.steps[number] for *_, number in header.components])
        tables = [header.chosen[name] for name in names]
        codes = np.stack([[header.codes[both >> 4], header.codes[BLOCK | both & 15]] for both in tables])
    except (ArithmeticError, LookupError, ValueError):  # Pillow's decoder reports what is wrong
        return True
    end = END_OF_CODES.search(data, header.end)
    for interval in BETWEEN_INTERVALS.split(data[header.end : end.start() if end else None]):
        count = min(header.restart or units, units)
        packed = np.frombuffer(interval.replace(b"\xff\0", b"\xff") + bytes(PADDING), np.uint8)
        if not fits(packed, count, kinds, codes, steps):
            return False
        units -= count
    return units == 0


def _header(data: bytes) -> Header | None:
    """Read everything before the codes; None for any JPEG that is not baseline with a single scan."""
    header, at = Header(), len(START)
    while True:
        while data[at + 1] == 0xFF:  # fill
            at += 1
        marker, length = data[at + 1], int.from_bytes(data[at + 2 : at + 4])
        if data[at] != 0xFF or length < 2:
            return None
        part, at = data[at + 4 : at + 2 + length], at + 2 + length
        if marker == TABLES_OF_STEPS:
            header.steps |= _steps(part)
        elif marker == TABLES_OF_CODES:
            header.codes |= _codes(part)
        elif marker == RESTART:
            header.restart = int.from_bytes(part)
        elif marker in BASELINE:
            header.size = int.from_bytes(part[1:3]), int.from_bytes(part[3:5])
            rows = (part[k : k + 3] for k in range(6, 6 + 3 * part[5], 3))
            header.components = [(name, sides >> 4, sides & 15, steps) for name, sides, steps in rows]
            if part[0] != 8 or 0 in header.size:
                return None
        elif marker in OTHER_FRAMES:
            return None
        elif marker == SCAN:
            header.chosen = dict(zip(part[1:-3:2], part[2:-3:2], strict=True))
            header.end = at
            return header if len(header.chosen) == len(header.components) > 0 else None


def _steps(part: bytes) -> Iterator[tuple[int, np.ndarray]]:
    while part:
        count = NUMBERS * (1 + (part[0] >> 4))
        steps = np.frombuffer(part[1 : 1 + count], ">u2" if part[0] >> 4 else "u1")
        yield part[0] & 15, steps.astype(np.int64)
        part = part[1 + count :]


def _codes(part: bytes) -> Iterator[tuple[int, np.ndarray]]:
    """Yield the key of each table (`BLOCK` or 0, plus its number) and its codes; unused bit patterns map to 0."""
    while part:
        counts, codes, at, first = part[1:17], np.zeros(2**LONGEST_CODE, np.int16), 17, 0
        for length, count in enumerate(counts, 1):
            wide = 2 ** (LONGEST_CODE - length)
            for symbol in part[at : at + count]:
                codes[first : first + wide] = 256 * length + symbol
                first += wide
            at += count
        yield part[0], codes
        part = part[at:]
