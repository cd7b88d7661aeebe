"""A loss that asks for the brushwork of another painting."""

from pathlib import Path

from torch import Tensor

from brushexp.plugins.loss.base import Loss, PaintedView
from brushexp.registry import register
from brushexp.strokes.brushwork import distances, load_brushwork
from brushexp.system.precision import at_least_single


@register("loss", "brushwork")
class BrushworkTransfer(Loss):
    """Optimal transport of lengths, widths, curvatures and directional coherence to those of a painting's catalogue.

    Brushwork transfer: the sum over these four measures, which `task=analyse` reports (``strokes.measures``), of the
    squared 2-Wasserstein distance between their distributions in both paintings, each in units of its variance in the
    reference: 0 for the same distributions, and about 1 for a measure that is off by one standard deviation. The
    numbers of strokes need not be equal. It looks at all strokes at every step, also where a step looks at a part of
    the canvas. Strokes too faint or too thin to be seen do not count and have no gradient. ``style.brushwork`` adds
    this loss and starts from strokes drawn accordingly.

    Args:
        option: what sets the catalogue, for messages.
        weight: factor in the sum of losses. For a reference of long, nearly straight strokes, ``style.brushwork`` with
            the default brought distances of 1.4 (length), 0.3 (width), 1.8 (curvature) and 0.7 (coherence) standard
            deviations down to 0.06 and less; the PSNR was 0.9 dB lower.
        catalogue: catalogue.h5 of the painting whose brushwork is wanted; null: none is, and the loss is 0.
    """

    weight = 0.001
    looks_at = "strokes"

    def __init__(self, option: str = "loss.brushwork.catalogue", *, catalogue: str | None = None) -> None:
        super().__init__()
        self.reference = None if catalogue is None else load_brushwork(Path(catalogue), option)

    def forward(self, view: PaintedView) -> Tensor:
        if self.reference is None:
            return view.strokes.width.sum() * 0
        strokes = view.strokes.map(at_least_single)
        self.reference = self.reference.to(strokes.width)
        size = (view.whole_target.shape[1], view.whole_target.shape[2])
        return distances(strokes, size, self.reference).sum()
