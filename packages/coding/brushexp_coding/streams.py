"""Write and read whole numbers: few of them as they are, and columns of many by the entropy coder."""

from dataclasses import dataclass, field

import numpy as np

from brushexp_coding import entropy
from brushexp_coding.entropy import Decoder, Distribution, Group

LONGEST = 10  # bytes of a whole number, of seven bits each


@dataclass
class Writer:
    """Collects numbers that describe columns, and the columns."""

    described: bytearray = field(default_factory=bytearray)
    groups: list[tuple[Distribution, Group]] = field(default_factory=list)

    def write(self, number: int) -> None:
        """Write a whole number of either sign: seven bits a byte, the lowest first (LEB128)."""
        rest = number << 1 if number >= 0 else (-number << 1) - 1
        while rest > 127:
            self.described.append(rest & 127 | 128)
            rest >>= 7
        self.described.append(rest)

    def write_column(self, numbers: Group, classes: Group) -> None:
        """Write numbers (N,) in classes (N,), each with its own distribution around the median."""
        middle = int(np.rint(np.median(numbers))) if len(numbers) else 0
        self.write(middle)
        for number in range(int(classes.max(initial=0)) + 1):
            part = numbers[classes == number] - middle
            distribution = entropy.fit(part)
            self.write(distribution.packed())
            self.groups.append((distribution, part))

    def to_bytes(self) -> bytes:
        """Return all that was written."""
        length = len(self.described).to_bytes(4, "little")
        return length + bytes(self.described) + entropy.encode(self.groups)


class Reader:
    """Reads what a `Writer` has written, in the same order; damage raises a ValueError."""

    def __init__(self, data: bytes) -> None:
        end = 4 + int.from_bytes(data[:4], "little")
        self._described, self._at, self._decoder = data[4:end], 0, Decoder(data[end:])

    def read(self) -> int:
        """Read a whole number."""
        rest = 0
        for place in range(LONGEST):
            if self._at >= len(self._described):
                break
            byte = self._described[self._at]
            self._at += 1
            rest |= (byte & 127) << 7 * place
            if byte < 128:
                return rest >> 1 if rest % 2 == 0 else -((rest + 1) >> 1)
        raise ValueError("a number is cut short")

    def read_column(self, classes: Group) -> Group:
        """Read the numbers (N,) of a column, whose ``classes`` are known."""
        middle, numbers = self.read(), np.zeros(len(classes), np.int64)
        for number in range(int(classes.max(initial=0)) + 1):
            chosen = classes == number
            numbers[chosen] = self._decoder.decode(Distribution.unpacked(self.read()), int(chosen.sum()))
        return numbers + middle
