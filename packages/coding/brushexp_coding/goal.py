"""Match the picture as closely as a file of a given size allows: ``bits=20kB``."""

from copy import deepcopy
from dataclasses import dataclass
from typing import Annotated

from omegaconf import DictConfig, open_dict

from brushexp.contracts import UserError, register
from brushexp.contracts.families import Change
from brushexp.contracts.painting import PIXELS_OF_A_STROKE, sizes_of
from brushexp_coding.sizes import SIZE, size_from, size_text

BITS = 85  # bits per stroke; on average 0.11 dB, at most 0.29 dB, below the best of six (benchmarks/byte_goal.py)
OVERHEAD = 60  # approximate bytes of a file without strokes


@register("change", "bits")
@dataclass(kw_only=True)
class BytesForStrokes(Change):
    """Choose the number of strokes and their rounding so that ``strokes.bits`` has a given size (as in ``bits=20kB``).

    More strokes match the picture more closely, but each stroke must then be rounded more coarsely. The decoded
    painting matches best at about 85 bits per stroke. The painting therefore has as many strokes as fit at 85 bits
    each, or fewer if you limit their number. The strokes are rounded as finely as the file size allows
    (``metric=bits``).

    Args:
        size: maximum size of strokes.bits: 1500B, 20kB, 0.5MB; null = no limit.
    """

    size: Annotated[str, SIZE] | None = None

    def settings(self, cfg: DictConfig) -> DictConfig:
        if self.size is None:
            return cfg
        most = int((size_from(self.size, "bits") - OVERHEAD) * 8 / BITS)
        if most < 1:
            raise UserError(f"bits={self.size} holds no stroke; type bits={size_text(OVERHEAD + BITS / 8)} or more")
        cfg = deepcopy(cfg)
        if cfg.catalogue is None:
            height, width = sizes_of(cfg).painting
            limits = most, max(1, height * width // PIXELS_OF_A_STROKE), cfg.max_strokes, cfg.strokes
            cfg.strokes = min(limit for limit in limits if limit is not None)
        with open_dict(cfg):
            cfg.metric.bits = {"_target_": "metric/bits", **cfg.metric.get("bits", {}), "size": self.size}
        return cfg
