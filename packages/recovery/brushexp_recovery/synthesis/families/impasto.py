"""Thick paint in rows of strokes of one hue, which can be told apart only by the light on their ridges."""

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
    ends_of,
    grey_tint,
    places_across,
    rows_for,
)


class Impasto(PaintFamily):
    """Strokes with ridges along the sides, bristle furrows in between, and a lump where the brush is lifted."""

    depth = (0.8, 5.0)
    lit_share = 1.0

    def __init__(self, random: Random) -> None:
        super().__init__(random)
        self.ridge = float(random.uniform(0.3, 2.0))
        self.furrow = float(random.uniform(0.05, 0.6))
        self.lump = float(random.choice([0.0, 0.8]))
        self.streak = float(random.choice([0.0, 0.02, 0.06]))

    def choose_hand(self) -> Hand:
        random = self.random
        return replace(
            choose_hand(random),
            aspect=(float(np.exp(random.uniform(np.log(2), np.log(14)))), float(random.uniform(0.1, 0.5))),
            color=float(random.choice([0.0, 0.15, 0.6])),
            palette=int(random.choice([0, 3, 5, 8])),
            row=int(random.choice([1, 4, 10])),
        )

    def draw(self, length: float) -> Sheet:
        random, rows = self.random, rows_for(length)
        cover = draw_outline(random, rows, COLUMNS, length, random.uniform(0, 0.15), random.uniform(0.1, 0.7))
        bristles = draw_bristles(random, rows, COLUMNS)
        across, tip = places_across(COLUMNS), ends_of(rows, length)[:, None]
        ridge = self.ridge * np.exp(-(((np.abs(across) - 0.85) / 0.18) ** 2))
        lump = self.lump * np.exp(-(((tip - 0.15) / 0.2) ** 2)) * (np.arange(rows)[:, None] > rows / 2)
        height = cover * (0.5 + self.furrow * bristles + ridge + lump)
        tint = grey_tint(1 + self.streak * bristles)
        return Sheet(cover, tint, height)
