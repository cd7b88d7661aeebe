"""Write and read integers: single numbers as bytes, and long columns with the entropy coder."""

from dataclasses import dataclass, field

import numpy as np

from brushexp_coding import entropy
from brushexp_coding.entropy import Decoder, Distribution, Group

LONGEST = 10  # maximum bytes per integer, with seven bits each


@dataclass
class Writer:
    """Collects columns of numbers, and single numbers that describe them."""

    described: bytearray = field(default_factory=bytearray)
    groups: list[tuple[Distribution, Group]] = field(default_factory=list)

    def write(self, number: int) -> None:
        """Write a signed integer with seven bits per byte, lowest bits first (LEB128)."""
        rest = number << 1 if number >= 0 else (-number << 1) - 1
        while rest > 127:
            self.described.append(rest & 127 | 128)
            rest >>= 7
        self.described.append(rest)

    def write_column(self, numbers: Group, classes: Group) -> None:
        """Write a column of numbers (N,); each class has its own distribution around the column's median."""
        middle = int(np.rint(np.median(numbers))) if len(numbers) else 0
        self.write(middle)
        for number in range(int(classes.max(initial=0)) + 1):
            part = numbers[classes == number] - middle
            distribution = entropy.fit(part)
            self.write(distribution.pack())
            self.groups.append((distribution, part))

    def to_bytes(self) -> bytes:
        """Return everything written so far as bytes."""
        length = len(self.described).to_bytes(4, "little")
        return length + bytes(self.described) + entropy.encode(self.groups)


class Reader:
    """Reads the output of a `Writer` in the same order; raises ValueError if the data are damaged."""

    def __init__(self, data: bytes) -> None:
        end = 4 + int.from_bytes(data[:4], "little")
        self._described, self._at, self._decoder = data[4:end], 0, Decoder(data[end:])

    def read(self) -> int:
        """Read a signed integer."""
        rest = 0
        for place in range(LONGEST):
            if self._at >= len(self._described):
                break
            byte = self._described[self._at]
            self._at += 1
            rest |= (byte & 127) << 7 * place
            if byte < 128:
                return rest >> 1 if rest % 2 == 0 else -((rest + 1) >> 1)
        raise ValueError("a number is truncated")

    def read_column(self, classes: Group) -> Group:
        """Read a column of numbers (N,), given their ``classes`` (N,)."""
        middle, numbers = self.read(), np.zeros(len(classes), np.int64)
        for number in range(int(classes.max(initial=0)) + 1):
            chosen = classes == number
            numbers[chosen] = self._decoder.decode(Distribution.unpack(self.read()), int(chosen.sum()))
        return numbers + middle
