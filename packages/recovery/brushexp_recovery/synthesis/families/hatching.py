"""Hatching with a dry brush: thin parallel strokes, broken by the grain of the canvas, on a visible ground."""

from dataclasses import replace

import numpy as np

from brushexp_recovery.synthesis.choices import choose_hand
from brushexp_recovery.synthesis.families.family import PaintFamily
from brushexp_recovery.synthesis.hand import Hand, Random
from brushexp_recovery.synthesis.sheets import (
    COLUMNS,
    Sheet,
    draw_bristles,
    draw_outline,
    grey_tint,
    rows_for,
    smooth_noise,
)


class Hatching(PaintFamily):
    """Lines whose paint runs out, first under the bristles that carry the least paint."""

    def __init__(self, random: Random) -> None:
        super().__init__(random)
        self.full = float(random.uniform(0.3, 2.5))
        self.dry = float(random.uniform(0.0, 2.5))
        self.grain = float(random.uniform(0.1, 1.0))
        self.sharp = float(random.uniform(0.8, 3.0))

    def choose_hand(self) -> Hand:
        random = self.random
        return replace(
            choose_hand(random),
            cover=float(random.uniform(0.4, 2.0)),
            aspect=(float(np.exp(random.uniform(np.log(4), np.log(25)))), float(random.uniform(0.1, 0.4))),
            hatch=float(random.choice([0.0, 0.5, 1.0])),
            color=float(random.choice([0.0, 0.3, 1.0])),
            palette=int(random.choice([0, 3, 6])),
            row=int(random.choice([4, 8, 16])),
        )

    def draw(self, length: float) -> Sheet:
        random, rows = self.random, rows_for(length)
        cover = draw_outline(random, rows, COLUMNS, length, random.uniform(0, 0.2), random.uniform(0.1, 1.0))
        share = np.linspace(0, 1, rows)[:, None]
        grain = smooth_noise(random, (rows, COLUMNS), random.uniform(0.5, 1.5))
        bristles = draw_bristles(random, rows, COLUMNS)
        paint = self.full - self.dry * share + 0.6 * bristles + self.grain * grain
        cover = cover * np.clip(self.sharp * paint + 0.5, 0, 1)
        return Sheet(cover, grey_tint(1 + 0.06 * bristles), 0.6 * cover)
