"""What losses in feature networks look at when a step looks at a part of the canvas."""

from collections.abc import Sequence

from torch import Tensor

from brushexp.features.base import Backbone
from brushexp.features.sight import sight_of
from brushexp.loss.base import Painting


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
