"""Slabs of palette-knife paint: flat, with sharp sides, a ridge along one side, and sometimes two colours."""

from dataclasses import replace

import numpy as np

from brushexp_recovery.synthesis.choices import choose_hand
from brushexp_recovery.synthesis.families.family import PaintFamily
from brushexp_recovery.synthesis.hand import Hand, Random
from brushexp_recovery.synthesis.sheets import (
    COLUMNS,
    Sheet,
    draw_outline,
    grey_tint,
    places_across,
    rows_for,
    smooth_noise,
)


class Slabs(PaintFamily):
    """Broad strokes made with a blade, in which the paint is scraped thin in places."""

    depth = (0.5, 4.0)
    lit_share = 0.9

    def __init__(self, random: Random) -> None:
        super().__init__(random)
        self.ridge = float(random.uniform(0.2, 1.5))
        self.scrape = float(random.choice([0.0, 0.5, 1.0]))
        self.load = float(random.choice([0.0, 0.0, 0.2]))

    def choose_hand(self) -> Hand:
        random = self.random
        return replace(
            choose_hand(random),
            aspect=(float(random.uniform(1.2, 5.0)), float(random.uniform(0.1, 0.4))),
            limits=(0.8, 8.0),
            sway=0.0,
        )

    def draw(self, length: float) -> Sheet:
        random, rows = self.random, rows_for(length)
        cover = draw_outline(random, rows, COLUMNS, length, random.uniform(0, 0.08), 0.05)
        patches = smooth_noise(random, (rows, COLUMNS), (random.uniform(3, 15), random.uniform(1, 5)))
        paint = np.clip(1.6 - self.scrape * (1 + patches), 0, 1)
        across = places_across(COLUMNS)
        ridge = self.ridge * np.exp(-(((across - random.choice([-0.9, 0.9])) / 0.1) ** 2))
        mixed = (self.load * random.normal(size=3)) * across[:, None]
        tint = grey_tint(1 + 0.03 * patches) + mixed
        cover = cover * paint
        return Sheet(cover, tint, cover * (0.7 + ridge))
