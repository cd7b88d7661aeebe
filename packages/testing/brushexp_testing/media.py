"""Check palettes and papers."""

import torch

from brushexp.contracts.families import Rows
from brushexp_testing.families import SIZE, Check, Make


def keeps_size_and_range(make: Make) -> None:
    """Check that a palette returns a picture of the same size with values in [0, 1].

    The result must be repeatable, and the original picture must not be modified.
    """
    picture = torch.rand(3, *SIZE)
    before, palette = picture.clone(), make()
    for one in (picture, torch.zeros(3, *SIZE), torch.ones(3, 1, 2)):
        target = palette(one)
        assert target.shape == one.shape
        assert target.dtype == torch.float32
        assert 0 <= target.min() <= target.max() <= 1
        assert torch.equal(target, palette(one))
    assert torch.equal(picture, before)


def is_one_paper_in_bands(make: Make) -> None:
    """Check that a paper and its relief are the same whether computed in bands of rows or all at once.

    Ground without paint must stay unchanged.
    """
    paper, flat, bare = make(), torch.rand(3, *SIZE), torch.tensor([0.2, 0.9, 0.5])
    whole = Rows(0, SIZE[0], SIZE)
    covered, relief = paper.cover(flat, bare, whole), paper.relief(whole)
    assert covered.shape == flat.shape
    assert covered.isfinite().all()
    assert relief.shape == SIZE
    assert relief.min() >= 0
    for top in range(0, SIZE[0], 8):
        rows = Rows(top, 8, SIZE)
        wide = rows.widened(paper.margin(SIZE))
        part = paper.cover(flat[:, wide.top : wide.top + wide.count], bare, wide)[:, top - wide.top :][:, :8]
        torch.testing.assert_close(part, covered[:, top : top + 8], atol=1e-5, rtol=0)
        torch.testing.assert_close(paper.relief(rows), relief[top : top + 8], atol=1e-6, rtol=0)
    ground = bare[:, None, None].expand(3, *SIZE)
    torch.testing.assert_close(paper.cover(ground, bare, whole), ground)


CHECKS: dict[str, list[Check]] = {"palette": [keeps_size_and_range], "paper": [is_one_paper_in_bands]}
