"""Brushwork transfer as a loss."""

from pathlib import Path

import torch
from torch import Tensor

from brushexp.plugins.loss.base import BrushworkLoss, PaintedView
from brushexp.registry import register
from brushexp.strokes.catalogue import Strokes
from brushexp.system.precision import at_least_single
from brushexp_style.imitation import distances, load_brushwork, with_brushwork


@register("loss", "brushwork")
class BrushworkTransfer(BrushworkLoss):
    """Optimal transport of lengths, widths, curvatures and directional coherence to those of a painting's catalogue.

    It is the sum over these four measures (``strokes.measures``, which `task=analyse` reports) of the squared
    2-Wasserstein distance between their distributions in both paintings, in units of the variance in the reference. It
    looks at all strokes at every step; strokes too faint or too thin to be seen do not count and have no gradient.
    ``style.brushwork`` adds this loss and draws the first strokes accordingly.

    Args:
        weight: factor in the sum of losses. For a reference of long, nearly straight strokes, ``style.brushwork`` with
            the default brought distances of 1.4 (length), 0.3 (width), 1.8 (curvature) and 0.7 (coherence) standard
            deviations down to 0.06 and less; the PSNR was 0.9 dB lower.
        catalogue: catalogue.h5 of the painting with the brushwork to take over; null for a loss of 0.
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

    def arranged(self, strokes: Strokes, size: tuple[int, int], generator: torch.Generator) -> Strokes:
        return strokes if self.reference is None else with_brushwork(strokes, self.reference, size, generator)
