"""Contact sheets: many small pictures of strokes as one picture."""

import torch
from torch import Tensor

from brushexp.training.evaluation import over_white

SHOWN_SIDE = 128  # pixels that a picture is magnified to, as far as whole factors allow
GAP_PIXELS, GAP_LEVEL = 4, 0.88  # between pictures, and their grey


def stroke_sheet(images: Tensor, columns: int) -> Tensor:
    """Pictures over white in rows: (3, height, width) in [0, 1].

    Args:
        images: (n, 4, H, W) RGBA in [0, 1], straight alpha.
        columns: pictures in a row.
    """
    from skimage.util import montage  # noqa: PLC0415  (a second)

    zoom, columns = max(1, SHOWN_SIDE // images.shape[-2]), min(columns, len(images))
    large = over_white(images).repeat_interleave(zoom, 2).repeat_interleave(zoom, 3).movedim(1, 3).cpu().numpy()
    layout = {"grid_shape": (-(-len(images) // columns), columns), "padding_width": GAP_PIXELS}
    return torch.from_numpy(montage(large, [GAP_LEVEL] * 3, channel_axis=3, **layout)).movedim(2, 0)
