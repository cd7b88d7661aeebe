"""What losses in feature networks look at when a step looks at a part of the canvas, and how much of it counts."""

from collections.abc import Sequence

from torch import Tensor

from brushexp.features.base import Backbone
from brushexp.features.sight import sight_of
from brushexp.pictures.focus import resized
from brushexp.pictures.region import Region
from brushexp.plugins.loss._target import OfTarget
from brushexp.plugins.loss.base import Painting


def framed(painting: Painting, network: Backbone, taps: Sequence[str]) -> Painting:
    """The painting with all that those activations depend on which see something of its part of the canvas."""
    if painting.surroundings is None:
        return painting
    sight = sight_of(network, taps)
    return painting.around(sight.margin, sight.grid)


def factors(
    painting: Painting, frame: Painting, found: Sequence[Tensor], network: Backbone, taps: Sequence[str]
) -> list[float]:
    """By which a mean over the positions of a frame is multiplied, so that it is a mean per pixel of the part.

    Times the part's share of the canvas, its gradient is then that of the mean over the positions of the whole canvas.

    Args:
        painting: the part.
        frame: what `framed` made of it.
        found: activations (..., h, w) of each tap there.
        network: the network.
        taps: names of its activations.
    """
    if painting.surroundings is None:
        return [1.0] * len(found)
    part, size = ((int(x.shape[1]), int(x.shape[2])) for x in (frame.target, painting.whole_target))
    return [share / painting.share for share in sight_of(network, taps).shares(found, part, size)]


def places(
    painting: Painting,
    frame: Painting,
    found: Sequence[Tensor],
    network: Backbone,
    taps: Sequence[str],
    kept: OfTarget[Tensor],
) -> list[Tensor | None]:
    """How much each position of a frame counts, (h, w) of each tap with a mean of 1 over the whole canvas.

    None where all count alike. They are means of the focus of the pixels over as many equal areas as the whole canvas
    has positions, of which those of the frame are taken.

    Args:
        painting: the part.
        frame: what `framed` made of it.
        found: activations (..., h, w) of each tap there.
        network: the network.
        taps: names of its activations.
        kept: keeps them from step to step.
    """
    focus = painting.whole_focus
    if focus is None:
        return [None] * len(found)
    sizes = [(int(value.shape[-2]), int(value.shape[-1])) for value in found]
    if painting.surroundings is None:
        return [_at(focus, size, kept) for size in sizes]
    sight = sight_of(network, taps)
    wide = painting.surroundings.wide(sight.margin, sight.grid)
    more = [side - part for side, part in zip(focus.shape, frame.target.shape[1:], strict=True)]
    weights: list[Tensor | None] = []
    for (height, width), stride in zip(sizes, sight.strides, strict=True):
        whole = _at(focus, (height + more[0] // stride, width + more[1] // stride), kept)
        weights.append(Region(wide.top // stride, wide.left // stride, height, width).of(whole))
    return weights


def _at(focus: Tensor, size: tuple[int, int], kept: OfTarget[Tensor]) -> Tensor:
    return kept.get(focus, lambda whole: resized(whole, size), key=size)
