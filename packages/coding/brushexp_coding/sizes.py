"""Parse and format file sizes as people write them: 1500B, 20kB, 0.5MB."""

import math
import re

from brushexp.contracts import Rule, UserError

BYTES = {"": 1, "b": 1, "k": 1e3, "kb": 1e3, "m": 1e6, "mb": 1e6}  # bytes per unit
LARGEST = 1e9  # bytes
DIGITS = 3  # significant digits of a written size


def size_from(text: str, option: str) -> int:
    """Parse a file size as a number of bytes; raise UserError if the text is not a size."""
    found = re.fullmatch(r"(\d+(?:\.\d*)?|\.\d+) ?([a-z]*)", text.lower())
    unit = BYTES.get(found[2]) if found else None
    if found is None or unit is None:
        raise UserError(f"{option}={text} is not a size; give bytes, {option}=1500B, or {option}=20kB or 0.5MB")
    size = float(found[1]) * unit
    if not 1 <= size <= LARGEST:
        raise UserError(f"{option}={text} is not 1B to {size_text(int(LARGEST))}; try {option}=20kB")
    return math.floor(size)


def size_text(size: float) -> str:
    """Format a size in bytes, rounded up to three significant digits.

    >>> size_text(950), size_text(1231), size_text(20_000), size_text(999_900), size_text(500_000)
    ('950B', '1.24kB', '20kB', '1MB', '500kB')
    """
    whole = math.ceil(size)
    tail = 10 ** max(0, len(str(whole)) - DIGITS)
    whole = -(-whole // tail) * tail
    unit = next((name for name in ("MB", "kB") if whole >= BYTES[name.lower()]), "B")
    return f"{whole / BYTES[unit.lower()]:g}{unit}"


SIZE = Rule(size_from)
