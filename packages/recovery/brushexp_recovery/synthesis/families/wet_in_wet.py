"""Wet paint dragged into adjacent paint: each bristle picks up the colours it passes and deposits them again."""

from dataclasses import replace

import numpy as np

from brushexp_recovery.synthesis.canvas import Mixing
from brushexp_recovery.synthesis.choices import choose_hand
from brushexp_recovery.synthesis.families.family import PaintFamily
from brushexp_recovery.synthesis.hand import Hand, Random
from brushexp_recovery.synthesis.sheets import COLUMNS, Sheet, draw_bristles, draw_outline, grey_tint, rows_for


class WetInWet(PaintFamily):
    """Nearly opaque strokes whose colours drift towards those of the paint below."""

    depth = (0.2, 3.0)

    def __init__(self, random: Random) -> None:
        super().__init__(random)
        self.drag = float(random.uniform(0.2, 0.85))
        self.opacity = float(random.uniform(0.75, 1.0))
        self.streak = float(random.uniform(0.0, 0.15))

    def choose_hand(self) -> Hand:
        hand = choose_hand(self.random)
        return replace(hand, cover=max(hand.cover, 2.0), row=int(self.random.choice([1, 3, 6])))

    def draw(self, length: float) -> Sheet:
        random, rows = self.random, rows_for(length)
        cover = draw_outline(random, rows, COLUMNS, length, random.uniform(0, 0.2), random.uniform(0.2, 1.0))
        bristles = draw_bristles(random, rows, COLUMNS)
        height = cover * (0.8 + 0.25 * bristles)
        tint = grey_tint(1 + self.streak * bristles)
        return Sheet(cover, tint, height)

    def mix(self, count: int) -> Mixing:
        drag = np.clip(self.drag * self.random.uniform(0.4, 1.2, count), 0, 0.9)
        return Mixing(1.0, opacity=np.full(count, self.opacity), wet=np.zeros(count), drag=drag)
