"""Translucent washes through which lower paint is visible, with pigment gathered at the rim."""

from dataclasses import replace

import numpy as np

from brushexp_recovery.synthesis.canvas import Mixing
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


class Washes(PaintFamily):
    """Strokes of thin paint; each pixel is labelled with the stroke that contributes most to it."""

    lit_share = 0.2

    def __init__(self, random: Random) -> None:
        super().__init__(random)
        self.opacity = float(random.uniform(0.35, 0.85))
        self.rim = float(random.uniform(0.0, 0.35))
        self.mottle = float(random.uniform(0.0, 0.25))

    def choose_hand(self) -> Hand:
        hand = choose_hand(self.random)
        return replace(hand, cover=float(self.random.uniform(0.5, 2.5)))

    def draw(self, length: float) -> Sheet:
        random, rows = self.random, rows_for(length)
        cover = draw_outline(random, rows, COLUMNS, length, random.uniform(0, 0.2), random.uniform(0.3, 1.0))
        mottle = smooth_noise(random, (rows, COLUMNS), random.uniform(2, 6))
        rim = np.exp(-(((np.abs(places_across(COLUMNS)) - 0.95) / 0.12) ** 2))
        tint = grey_tint(np.broadcast_to(1 - self.rim * rim, (rows, COLUMNS)))
        film = np.clip(1 - self.mottle * (0.5 + mottle), 0.2, 1)
        return Sheet(cover * film, tint, 0.05 * cover)

    def mix(self, count: int) -> Mixing:
        opacity = np.clip(self.opacity + 0.1 * self.random.normal(size=count), 0.2, 1)
        return Mixing(1.0, opacity=opacity, wet=np.zeros(count), drag=np.zeros(count))
