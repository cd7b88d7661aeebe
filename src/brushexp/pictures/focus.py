"""Weight pixels by importance, using a mask or an estimate of where people look first."""

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from brushexp.pictures.color import to_lab
from brushexp.pictures.face import Face
from brushexp.pictures.load import downsample, load_mask

AUTO = "auto"  # value of focus and faces: detect them in the picture
OFF = "off"  # value of faces: detect none
SALIENCY_SIDE = 64  # pixels on the longer side at which the composition of a picture is judged
BLUR = 0.045  # blur of the maps, in longer sides, as in Hou et al.
CENTRE = 0.3  # standard deviation in sides: people look near the middle, and place their subjects there
ROUNDING = 1e-3  # Lab units below which differences are due to rounding
FACE_REACH = 0.7  # distance from the middle of a face, in its sides, at which attention falls to 1/e
SHARP_SIDE = 512  # pixels on the longer side at which sharp edges are detected
SHARP_SLOPE = 1.5, 8.0  # L* per pixel: slope of a blurred edge, and of a fully sharp one
SHARP_BLUR = 0.025  # blur of the map of sharp edges, in longer sides
SHARP_SHARE = 0.35  # share of sharp edges in a fully sharp area
SHARP_ATTENTION = 0.5  # attention to an area that is sharp but not salient
ATTENTION_OUTSIDE_FACES = 0.5  # factor on the attention outside the faces of a picture


def focus_map(focus: str, target: Tensor, faces: Sequence[Face] = ()) -> Tensor:
    """Read the importance (H, W), 0 to 1, of a picture's pixels from a mask, or estimate it if ``focus`` is auto."""
    if focus == AUTO:
        return attention(target, faces)
    return load_mask(focus, (target.shape[1], target.shape[2]), "focus", f"{AUTO}, ")


def focus_weights(attended: Tensor, strength: float) -> Tensor:
    """Compute weights 1 + (strength - 1) m from a map m (H, W) in [0, 1], and normalise them to mean 1; float32."""
    weights = 1 + (strength - 1) * attended.double()
    return (weights / weights.mean()).to(torch.float32)


def resample_weights(weights: Tensor, size: tuple[int, int]) -> Tensor:
    """Resample weights (H, W) to another resolution by area averaging, preserving their mean."""
    if weights.shape == size:
        return weights
    means = functional.adaptive_avg_pool2d(weights[None].double(), size)[0]
    return (means * (weights.double().mean() / means.mean())).to(weights.dtype)


def attention(picture: Tensor, faces: Sequence[Face]) -> Tensor:
    """Estimate a map (H, W) of where people look first, float32 from 0 to 1; it is 0 for a uniform picture.

    Saliency is the image signature (Hou, Harel and Koch, 2012, "Image signature: highlighting sparse salient regions"):
    the cosine transform of each Lab channel is reduced to its signs, and the square of their inverse transform is high
    where something stands out. Detail is the gradient magnitude of the Lab channels. Both are smoothed, and the root of
    their product is weighted by a Gaussian around the centre (Judd et al., 2009). Areas in focus, which have sharp
    edges, get part of the attention regardless of their position. ``faces`` are added following Cerf et al. (2007). The
    combination is our own and was chosen by eye on ten photographs.
    """
    from scipy.ndimage import gaussian_filter  # noqa: PLC0415  (rarely needed)

    size = (picture.shape[1], picture.shape[2])
    small = _shrink(picture, SALIENCY_SIDE)
    lab: np.ndarray = to_lab(small.reshape(-1, 3).astype(np.float64)).reshape(small.shape)
    sigma = BLUR * max(lab.shape[:2])
    saliency, detail = (gaussian_filter(values, sigma) for values in (_signature(lab), _slope(lab)))
    height, width = lab.shape[:2]
    rows, columns = (np.arange(height) + 0.5) / height - 0.5, (np.arange(width) + 0.5) / width - 0.5
    middle = np.exp(-(rows[:, None] ** 2 + columns**2) / (2 * CENTRE**2))
    salient = np.sqrt((saliency - saliency.min()) * (detail - detail.min())) * middle
    highest = salient.max()
    salient = salient / highest if highest > ROUNDING else np.zeros_like(salient)
    attended = torch.maximum(_enlarge(salient, size), SHARP_ATTENTION * sharpness(picture))
    attended = attended * (ATTENTION_OUTSIDE_FACES if faces else 1)
    for face in faces:  # a round plateau, 1 in the middle, 1/e at ``FACE_REACH`` sides, and soon 0 beyond
        down, across = torch.arange(size[0]) + 0.5 - face.y, torch.arange(size[1]) + 0.5 - face.x
        distance = (down[:, None].square() + across.square()) / (FACE_REACH * face.side) ** 2
        attended = torch.maximum(attended, torch.exp(-distance.square()))
    return attended.to(torch.float32).clamp(0, 1)


def sharpness(picture: Tensor) -> Tensor:
    """Measure the local edge sharpness (H, W) in a picture (3, H, W), float64 from 0 (blurred or uniform) to 1."""
    from scipy.ndimage import gaussian_filter, gaussian_gradient_magnitude  # noqa: PLC0415  (rarely needed)

    small = downsample(picture, SHARP_SIDE).double()
    zoom = SHARP_SIDE / max(small.shape)  # enlarged if smaller, so that its edges are equally sharp
    size = [max(1, round(zoom * side)) for side in small.shape[1:]]
    planes = functional.interpolate(small[None], size, mode="bilinear", align_corners=False)[0].clamp(0, 1)
    lightness = to_lab(planes.flatten(1).T.cpu().numpy())[:, 0].reshape(size)
    blurred, crisp = SHARP_SLOPE
    edges = ((gaussian_gradient_magnitude(lightness, 1.0) - blurred) / (crisp - blurred)).clip(0, 1)
    sharp = (gaussian_filter(edges, SHARP_BLUR * max(edges.shape)) / SHARP_SHARE).clip(0, 1)
    return _enlarge(sharp, (picture.shape[1], picture.shape[2]))


def _enlarge(values: np.ndarray, size: tuple[int, int]) -> Tensor:
    wide = functional.interpolate(torch.from_numpy(values)[None, None], size, mode="bilinear", align_corners=False)
    return wide[0, 0]


def _signature(lab: np.ndarray) -> np.ndarray:
    from scipy.fft import dctn, idctn  # noqa: PLC0415  (rarely needed)

    frequencies = dctn(lab, axes=(0, 1), norm="ortho")
    signs = np.where(np.abs(frequencies) > ROUNDING, np.sign(frequencies), 0)
    return np.square(idctn(signs, axes=(0, 1), norm="ortho")).sum(2)


def _slope(lab: np.ndarray) -> np.ndarray:
    """Compute the gradient magnitude (h, w) over all channels (h, w, 3), at a scale of one pixel."""
    from scipy.ndimage import gaussian_gradient_magnitude  # noqa: PLC0415  (rarely needed)

    squares: np.ndarray = sum(gaussian_gradient_magnitude(channel, 1.0) ** 2 for channel in np.moveaxis(lab, 2, 0))
    return np.sqrt(squares)


def _shrink(picture: Tensor, side: int) -> np.ndarray:
    return downsample(picture, side).permute(1, 2, 0).clamp(0, 1).cpu().numpy()
