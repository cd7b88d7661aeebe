"""Code groups of integers with a range coder and a distribution fitted to each group.

A distribution is a discretised Student's t-distribution with extra weight at 0. Its weights are computed only with
sums, products and quotients in double precision, which IEEE 754 defines exactly, so that a file written on one machine
can be decoded on any other machine.
"""

from dataclasses import dataclass
from functools import cache
from itertools import product

import numpy as np
from constriction import stream

RADIUS = 127  # largest magnitude with a weight of its own
ESCAPE = 2 * RADIUS + 1  # symbol announcing a larger number, which follows in plain bits
ESCAPE_WEIGHT = 2.0**-12  # weight of the escape symbol, as a share of all weights
ROOT_2 = 1.4142135623730951
SCALES = tuple(0.25 * 2 ** (step // 2) * (ROOT_2 if step % 2 else 1.0) for step in range(16))
POWERS = (1, 2, 4, 8)  # exponents of the tails, from Cauchy's to nearly Gaussian
AT_ZERO = (0.0, 0.125, 0.25, 0.5, 0.75, 0.875, 0.96875, 0.9921875)  # weight added at 0, as a share of all weights
WORD, PLAIN_WORDS = 16, 3  # number of bits in a piece of a plain number, and number of pieces
LARGEST = 2 ** (WORD * PLAIN_WORDS - 2)  # exclusive bound on the magnitude of numbers that can be coded
MAX_SHIFT = 48

Group = np.ndarray  # (n,) int64


@dataclass(frozen=True)
class Distribution:
    """A distribution of integers whose lowest ``shift`` bits are stored verbatim."""

    shift: int = 0
    scale: int = 0  # index into `SCALES`
    power: int = 0  # index into `POWERS`
    at_zero: int = 0  # index into `AT_ZERO`

    def pack(self) -> int:
        """Pack the distribution into an integer."""
        return ((self.shift * len(SCALES) + self.scale) * len(POWERS) + self.power) * len(AT_ZERO) + self.at_zero

    @classmethod
    def unpack(cls, packed: int) -> "Distribution":
        """Unpack a distribution; raise ValueError if the number does not represent one."""
        rest, at_zero = divmod(packed, len(AT_ZERO))
        rest, power = divmod(rest, len(POWERS))
        shift, scale = divmod(rest, len(SCALES))
        if not 0 <= shift <= MAX_SHIFT:
            raise ValueError(f"{packed} is not a distribution")
        return cls(shift, scale, power, at_zero)


@cache
def weights_of(scale: int, power: int, at_zero: int) -> np.ndarray:
    """Compute the weights (2 * RADIUS + 2,) of the numbers from -RADIUS to RADIUS and of the escape symbol."""
    numbers = np.arange(-RADIUS, RADIUS + 1, dtype=np.float64)
    far = 1.0 + (numbers / SCALES[scale]) * (numbers / SCALES[scale])
    tails = far
    for _ in range(POWERS[power].bit_length() - 1):
        tails = tails * tails
    weights = 1.0 / tails
    total = 0.0
    for weight in weights.tolist():  # in sequence, because a pairwise sum depends on the machine
        total += weight
    weights = weights / total * (1.0 - AT_ZERO[at_zero])
    weights[RADIUS] += AT_ZERO[at_zero]
    return np.append(weights, ESCAPE_WEIGHT)


@cache
def _bits() -> tuple[list[tuple[int, int, int]], np.ndarray]:
    """Compute the bits (M, 2 * RADIUS + 2) that each symbol needs under each of M distributions."""
    kinds = list(product(range(len(SCALES)), range(len(POWERS)), range(len(AT_ZERO))))
    weights = np.stack([weights_of(*kind) for kind in kinds])
    shares = weights / weights.sum(1, keepdims=True)
    return kinds, -np.log2(np.maximum(shares, 2.0**-24))


def fit(numbers: Group) -> Distribution:
    """Find the distribution that codes the numbers (n,) in the fewest bits."""
    if not len(numbers):
        return Distribution()
    kinds, bits = _bits()
    best, least = Distribution(), np.inf
    spread = int(np.quantile(np.abs(numbers), 0.9)).bit_length()
    for shift in range(max(0, spread - 7), max(0, spread - 3) + 1):
        symbols = _symbols(numbers >> shift)
        counts = np.bincount(symbols, minlength=ESCAPE + 1)
        costs = bits @ counts + shift * len(numbers) + WORD * PLAIN_WORDS * counts[ESCAPE]
        cheapest = int(costs.argmin())
        if costs[cheapest] < least:
            best, least = Distribution(shift, *kinds[cheapest]), float(costs[cheapest])
    return best


def bits_of(distribution: Distribution, numbers: Group) -> float:
    """Estimate the number of bits that a distribution needs to code numbers."""
    counts = np.bincount(_symbols(numbers >> distribution.shift), minlength=ESCAPE + 1)
    weights = weights_of(distribution.scale, distribution.power, distribution.at_zero)
    bits = -np.log2(np.maximum(weights / weights.sum(), 2.0**-24))
    return float(bits @ counts) + distribution.shift * len(numbers) + WORD * PLAIN_WORDS * int(counts[ESCAPE])


def encode(groups: list[tuple[Distribution, Group]]) -> bytes:
    """Encode groups of numbers in sequence; all magnitudes must be below `LARGEST`."""
    coder = stream.queue.RangeEncoder()
    for distribution, numbers in groups:
        if not len(numbers):
            continue
        high = numbers >> distribution.shift
        symbols = _symbols(high)
        coder.encode(symbols.astype(np.int32), _model(distribution))
        _encode_plain(coder, numbers & ((1 << distribution.shift) - 1), distribution.shift)
        _encode_plain(coder, high[symbols == ESCAPE] + LARGEST, WORD * PLAIN_WORDS)
    return coder.get_compressed().astype("<u4").tobytes()


class Decoder:
    """Decodes groups coded by `encode`, in the same order; raises ValueError if the data are damaged."""

    def __init__(self, data: bytes) -> None:
        if len(data) % 4:
            raise ValueError("the coded numbers are truncated")
        self._coder = stream.queue.RangeDecoder(np.frombuffer(data, "<u4").astype(np.uint32))

    def decode(self, distribution: Distribution, count: int) -> Group:
        """Decode the next group of ``count`` numbers."""
        if not count:
            return np.zeros(0, np.int64)
        try:
            symbols = np.asarray(self._coder.decode(_model(distribution), count), np.int64)
            low = self._plain(distribution.shift, count)
            escaped = symbols == ESCAPE
            high = symbols - RADIUS
            high[escaped] = self._plain(WORD * PLAIN_WORDS, int(escaped.sum())) - LARGEST
        except AssertionError as error:  # raised by the library
            raise ValueError("the coded numbers are damaged") from error
        return (high << distribution.shift) | low

    def _plain(self, bits: int, count: int) -> Group:
        numbers = np.zeros(count, np.int64)
        for begin in range(0, bits if count else 0, WORD):
            piece = self._coder.decode(stream.model.Uniform(1 << min(WORD, bits - begin)), count)
            numbers |= np.asarray(piece, np.int64) << begin
        return numbers


def _symbols(numbers: Group) -> Group:
    return np.where(np.abs(numbers) <= RADIUS, numbers + RADIUS, ESCAPE)


@cache
def _model(distribution: Distribution) -> "stream.model.Categorical":
    return stream.model.Categorical(
        weights_of(distribution.scale, distribution.power, distribution.at_zero), perfect=False
    )


def _encode_plain(coder: "stream.queue.RangeEncoder", numbers: Group, bits: int) -> None:
    for begin in range(0, bits if len(numbers) else 0, WORD):
        width = min(WORD, bits - begin)
        coder.encode(((numbers >> begin) & ((1 << width) - 1)).astype(np.int32), stream.model.Uniform(1 << width))
