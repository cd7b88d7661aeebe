"""Real strokes: scans of acrylic strokes by a flat brush, fully loaded to dry, bent along curves and recoloured.

Renderers draw marks from the same scans (`brushexp.strokes.scanned`).
"""

from dataclasses import replace

import numpy as np

from brushexp.contracts.strokes import read_scans
from brushexp_recovery.synthesis.choices import choose_hand
from brushexp_recovery.synthesis.families.family import PaintFamily
from brushexp_recovery.synthesis.hand import Hand, Random
from brushexp_recovery.synthesis.sheets import Sheet, draw_bristles, grey_tint


class Scanned(PaintFamily):
    """Strokes that are each drawn from one scan, sometimes mirrored, with a varying amount of paint."""

    def __init__(self, random: Random) -> None:
        super().__init__(random)
        sheets = read_scans()
        some = random.choice(len(sheets), int(random.integers(4, len(sheets) + 1)), replace=False)
        self.sheets = sheets[some]
        self.load = float(np.exp(random.uniform(-0.9, 0.6)))
        self.streak = float(random.choice([0.0, 0.05, 0.12]))

    def choose_hand(self) -> Hand:
        aspect = float(np.exp(self.random.uniform(np.log(2), np.log(9))))
        hand = choose_hand(self.random)
        return replace(hand, aspect=(aspect, hand.aspect[1]), row=int(self.random.choice([1, 1, 3, 8])))

    def draw(self, length: float) -> Sheet:
        random = self.random
        cover = self.sheets[int(random.integers(len(self.sheets)))].astype(np.float32) / 255
        cover = cover[:, ::-1] if random.random() < 0.5 else cover
        cover = cover ** (self.load * np.exp(0.2 * random.normal()))
        bristles = draw_bristles(random, *cover.shape)
        return Sheet(cover, grey_tint(1 + self.streak * bristles), cover * (1 + 0.3 * bristles))
