"""Test that strata double the number of strokes, and that new strokes are placed on top."""

import torch
from brushexp_policies.strata import Strata
from painters import take
from test_density import painter_of

from brushexp.strokes.bezier import half_width_of


def test_strokes_double_in_number_and_shrink_and_new_ones_lie_on_top():
    noise = torch.rand(1, 3, 16, 24, generator=torch.Generator().manual_seed(0))
    target = torch.nn.functional.interpolate(noise, (64, 96), mode="bicubic")[0].clamp(0, 1)
    painter = painter_of(Strata(tolerance=0.0), n=80, steps=80, target=target)
    counts, sizes = [len(painter.catalogue)], []
    for _ in range(painter.schedule.steps):
        take(painter, 1)
        if (n := len(painter.catalogue)) > counts[-1]:
            new = n - counts[-1]
            assert set(painter.front_to_back[:new].tolist()) == set(range(counts[-1], n))
            sizes.append(float(half_width_of(painter.strokes())[-new:].median()))
            counts.append(n)
    assert counts == [5, 10, 20, 40, 80]
    assert sizes == sorted(sizes, reverse=True)
