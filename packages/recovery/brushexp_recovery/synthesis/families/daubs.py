"""Large, opaque daubs of flat and sometimes dark colour on a coarse canvas, with visible bristle marks."""

from dataclasses import replace

from brushexp_recovery.synthesis.choices import choose_hand
from brushexp_recovery.synthesis.families.family import PaintFamily
from brushexp_recovery.synthesis.hand import Hand, Random
from brushexp_recovery.synthesis.sheets import COLUMNS, Sheet, draw_bristles, draw_outline, grey_tint, rows_for


class Daubs(PaintFamily):
    """Wide strokes in few colours, which recovery must not split along bristle marks or canvas threads."""

    depth = (0.3, 3.0)
    lit_share = 0.8

    def __init__(self, random: Random) -> None:
        super().__init__(random)
        self.dark = float(random.choice([1.0, 1.0, random.uniform(0.1, 0.6)]))
        self.streak = float(random.uniform(0.0, 0.2))
        self.furrow = float(random.uniform(0.0, 0.5))

    def choose_hand(self) -> Hand:
        random = self.random
        return replace(
            choose_hand(random),
            cover=float(random.uniform(0.3, 2.5)),
            aspect=(float(random.uniform(1.5, 5.0)), float(random.uniform(0.1, 0.4))),
            limits=(1.0, 8.0),
            palette=int(random.choice([1, 2, 4, 8])),
            color=float(random.choice([0.0, 0.3, 1.0])),
            uneven=float(random.uniform(0.0, 0.4)),
        )

    def draw(self, length: float) -> Sheet:
        random, rows = self.random, rows_for(length)
        cover = draw_outline(random, rows, COLUMNS, length, random.uniform(0, 0.25), random.uniform(0.1, 0.8))
        bristles = draw_bristles(random, rows, COLUMNS)
        tone = self.dark * (1 + self.streak * bristles)
        height = cover * (0.6 + self.furrow * bristles)
        return Sheet(cover, grey_tint(tone), height)
