"""Contact sheets: many small pictures of strokes as one picture."""

import torch
from torch import Tensor
from torch.nn import functional

from brushexp.training.evaluation import over_white

SHOWN_SIDE = 128  # pixels that a picture is magnified to, as far as whole factors allow
GAP_PIXELS, GAP_LEVEL = 4, 0.88  # between pictures, and their grey


def stroke_sheet(images: Tensor, columns: int) -> Tensor:
    """Pictures over white in rows: (3, height, width) in [0, 1].

    Args:
        images: (n, 4, H, W) RGBA in [0, 1], straight alpha.
        columns: pictures in a row.
    """
    zoom = max(1, SHOWN_SIDE // images.shape[-2])
    large = over_white(images).repeat_interleave(zoom, 2).repeat_interleave(zoom, 3)
    framed = functional.pad(large, (0, GAP_PIXELS, 0, GAP_PIXELS), value=GAP_LEVEL)
    columns = min(columns, len(framed))
    missing = -len(framed) % columns
    framed = torch.cat([framed, framed.new_full((missing, *framed.shape[1:]), GAP_LEVEL)])
    rows = [torch.cat(list(row), dim=2) for row in framed.split(columns)]
    return functional.pad(torch.cat(rows, dim=1), (GAP_PIXELS, 0, GAP_PIXELS, 0), value=GAP_LEVEL)
