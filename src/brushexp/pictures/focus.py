"""Pixels are weighted by where accuracy matters: a mask, or what people look at first."""

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from brushexp.pictures.color import to_lab
from brushexp.pictures.load import downsample, load_mask

Face = tuple[tuple[float, float], float]  # middle (y, x) and side of the square around it, in pixels

AUTO = "auto"  # focus that is found in the picture
GLANCE_SIDE = 64  # pixels of the longer side at which a picture is looked at as a whole
BLUR = 0.045  # longer sides, of the maps: as Hou et al. smooth theirs
CENTRE = 0.3  # sides, standard deviation: people look, and put what they show, near the middle
ROUNDING = 1e-3  # of a Lab unit: differences below it are rounding
FACE_SIDE, FACE_LEAST = 256, 32  # pixels: longer side at which faces are sought, and the smallest face there
FACE_SCALES = 1.1  # ratio of the sizes at which faces are sought
FACE_REACH = 0.7  # sides of the square that a face was found in: how far from its middle attention halves or so
BESIDE_FACES = 0.5  # of the attention that everything else keeps where there is a face


def focus_map(focus: str, target: Tensor) -> tuple[Tensor, list[Face]]:
    """Map how much pixels of a picture (3, H, W) matter, 0 to 1 (H, W), by ``auto``, which finds faces, or a file."""
    if focus == AUTO:
        return attention(target, found := faces(target)), found
    return load_mask(focus, (target.shape[1], target.shape[2]), "focus", f"{AUTO}, "), []


def focus_weights(attended: Tensor, strength: float) -> Tensor:
    """Compute 1 + (strength - 1) m for a map m (H, W) in [0, 1], divided by its mean; float32 of mean 1."""
    weights = 1 + (strength - 1) * attended.double()
    return (weights / weights.mean()).to(torch.float32)


def resized(weights: Tensor, size: tuple[int, int]) -> Tensor:
    """Average weights (H, W) over areas to another resolution, with the same mean."""
    if weights.shape == size:
        return weights
    means = functional.adaptive_avg_pool2d(weights[None].double(), size)[0]
    return (means * (weights.double().mean() / means.mean())).to(weights.dtype)


def attention(picture: Tensor, squares: Sequence[Face]) -> Tensor:
    """Estimate where people look first, (H, W) float32 from 0 to 1; all 0 for a picture that is even.

    Saliency is the image signature (Hou, Harel and Koch, 2012, "Image signature: highlighting sparse salient regions"):
    of each Lab channel the cosine transform keeps its signs only, and what is bright in the squared inverse stands out.
    Detail is the slope of the Lab channels. Both are smoothed, and the root of their product is weighed with a Gaussian
    around the middle (Judd et al., 2009). Faces, those of ``squares``, are added as Cerf et al. (2007) do. Differs from
    the sources in this combination, which was chosen by eye on three photographs.
    """
    from scipy.ndimage import gaussian_filter  # noqa: PLC0415  (rarely needed)

    size = (picture.shape[1], picture.shape[2])
    small = _shrunk(picture, GLANCE_SIDE)
    lab: np.ndarray = to_lab(small.reshape(-1, 3).astype(np.float64)).reshape(small.shape)
    sigma = BLUR * max(lab.shape[:2])
    saliency, detail = (gaussian_filter(values, sigma) for values in (_signature(lab), _slope(lab)))
    height, width = lab.shape[:2]
    rows, columns = (np.arange(height) + 0.5) / height - 0.5, (np.arange(width) + 0.5) / width - 0.5
    middle = np.exp(-(rows[:, None] ** 2 + columns**2) / (2 * CENTRE**2))
    salient = np.sqrt((saliency - saliency.min()) * (detail - detail.min())) * middle
    highest = salient.max()
    salient = salient / highest if highest > ROUNDING else np.zeros_like(salient)
    wide = functional.interpolate(torch.from_numpy(salient)[None, None], size, mode="bilinear", align_corners=False)
    attended = wide[0, 0] * (BESIDE_FACES if squares else 1)
    for (y, x), side in squares:  # a round plateau, 1 in the middle, 1/e at ``FACE_REACH`` sides, and soon 0 beyond
        down, across = torch.arange(size[0]) + 0.5 - y, torch.arange(size[1]) + 0.5 - x
        distance = (down[:, None].square() + across.square()) / (FACE_REACH * side) ** 2
        attended = torch.maximum(attended, torch.exp(-distance.square()))
    return attended.to(torch.float32).clamp(0, 1)


def _signature(lab: np.ndarray) -> np.ndarray:
    from scipy.fft import dctn, idctn  # noqa: PLC0415  (rarely needed)

    frequencies = dctn(lab, axes=(0, 1), norm="ortho")
    signs = np.where(np.abs(frequencies) > ROUNDING, np.sign(frequencies), 0)
    return np.square(idctn(signs, axes=(0, 1), norm="ortho")).sum(2)


def _slope(lab: np.ndarray) -> np.ndarray:
    """Compute the length of the gradient (h, w) of all channels (h, w, 3), at a scale of one pixel."""
    from scipy.ndimage import gaussian_gradient_magnitude  # noqa: PLC0415  (rarely needed)

    squares: np.ndarray = sum(gaussian_gradient_magnitude(channel, 1.0) ** 2 for channel in np.moveaxis(lab, 2, 0))
    return np.sqrt(squares)


def faces(picture: Tensor) -> list[Face]:
    """Find frontal faces of a picture (3, H, W) by the cascade of local binary patterns that scikit-image ships."""
    small = _shrunk(picture, FACE_SIDE)
    if min(small.shape[:2]) <= FACE_LEAST:
        return []
    from skimage.color import rgb2gray  # noqa: PLC0415  (slow to import)
    from skimage.data import lbp_frontal_face_cascade_filename  # noqa: PLC0415
    from skimage.exposure import equalize_hist  # noqa: PLC0415
    from skimage.feature import Cascade  # noqa: PLC0415

    cascade, (short, _) = Cascade(lbp_frontal_face_cascade_filename()), sorted(small.shape[:2])
    light = equalize_hist(rgb2gray(small))  # so that dark faces, and faces in the dark, are found like others

    def look(at: np.ndarray) -> list[tuple[float, float, float]]:
        pixels = np.ascontiguousarray(np.rint(255 * at).astype(np.uint8))
        detected = cascade.detect_multi_scale(pixels, FACE_SCALES, 1, (FACE_LEAST,) * 2, (short,) * 2)
        return [(face["r"] + face["height"] / 2, face["c"] + face["width"] / 2, face["width"]) for face in detected]

    detected = look(light)
    mirrored = [(y, light.shape[1] - x) for y, x, _ in look(light[:, ::-1])] if detected else []
    zoom = max(picture.shape[1:]) / max(small.shape[:2])
    return [
        ((zoom * y, zoom * x), zoom * side)
        for y, x, side in detected  # most of what it takes for a face by mistake is none in the mirror
        if any(max(abs(y - other_y), abs(x - other_x)) < side / 2 for other_y, other_x in mirrored)
    ]


def _shrunk(picture: Tensor, side: int) -> np.ndarray:
    return downsample(picture, side).permute(1, 2, 0).clamp(0, 1).cpu().numpy()
