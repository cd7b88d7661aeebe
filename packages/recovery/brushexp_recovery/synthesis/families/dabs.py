"""Dabs of a round brush: short touches that are thick in the middle, separate or overlapping."""

from dataclasses import replace

from brushexp_recovery.synthesis.choices import choose_hand
from brushexp_recovery.synthesis.families.family import PaintFamily
from brushexp_recovery.synthesis.hand import Hand, Random
from brushexp_recovery.synthesis.sheets import (
    COLUMNS,
    Sheet,
    draw_bristles,
    draw_outline,
    grey_tint,
    places_across,
    rows_for,
)


class Dabs(PaintFamily):
    """Dabs that are at most four times as long as they are wide."""

    depth = (0.3, 4.0)

    def __init__(self, random: Random) -> None:
        super().__init__(random)
        self.rough = float(random.uniform(0.02, 0.25))
        self.bulge = float(random.uniform(-0.5, 1.0))

    def choose_hand(self) -> Hand:
        random = self.random
        return replace(
            choose_hand(random),
            cover=float(random.uniform(0.4, 3.0)),
            aspect=(float(random.uniform(1.1, 2.4)), float(random.uniform(0.05, 0.3))),
            limits=(0.6, 4.0),
            row=int(random.choice([1, 5])),
        )

    def draw(self, length: float) -> Sheet:
        random, rows = self.random, rows_for(length)
        cover = draw_outline(random, rows, COLUMNS, length, self.rough, random.uniform(0.2, 0.6))
        bristles = draw_bristles(random, rows, COLUMNS)
        height = cover * (0.8 + self.bulge * (1 - places_across(COLUMNS) ** 2) + 0.15 * bristles)
        tint = grey_tint(1 + 0.05 * bristles)
        return Sheet(cover, tint, height)
