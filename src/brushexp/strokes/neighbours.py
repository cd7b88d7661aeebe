"""Which strokes are near."""

import torch
from torch import Tensor

NEIGHBOURS = 10  # strokes around a stroke that say which direction is usual there (as in Kotovenko et al., 2021)


@torch.no_grad()
def nearest(points: Tensor, others: Tensor, k: int, *, exclude_self: bool) -> Tensor:
    """Indices (Q, k) of the k nearest of ``others`` (N, 2) to each of ``points`` (Q, 2); of all if they are fewer.

    With ``exclude_self`` the points are the others themselves, and none is its own neighbour.
    """
    from scipy.spatial import cKDTree  # noqa: PLC0415  (slow to import)

    k = min(k, len(others) - exclude_self)
    if k < 1:
        return torch.empty(len(points), 0, dtype=torch.long, device=points.device)
    places, around = (x.detach().cpu().double().numpy() for x in (points, others))  # numpy has no bfloat16
    tree = cKDTree(around)
    workers = torch.get_num_threads()
    found = torch.from_numpy(tree.query(places, k=k + exclude_self, workers=workers)[1])
    found = found.reshape(len(points), k + exclude_self).to(points.device)
    if exclude_self:  # where strokes share a place, the stroke itself need not come first, nor be found at all
        own = found == torch.arange(len(points), device=points.device)[:, None]
        found = found[:, 1:] if own[:, 0].all() else found.gather(1, own.long().argsort(dim=1, stable=True))[:, :k]
    return found
