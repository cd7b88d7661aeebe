"""Simulate how ageing, lighting and the camera change a picture of a painting."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp.contracts.layers import Light, normals_of, shade_picture
from brushexp_recovery.raster.blur import gaussian_blur
from brushexp_recovery.raster.jpeg import compress_as_jpeg
from brushexp_recovery.synthesis.hand import Random

Array = NDArray[Any]

VARNISH = (0.2, 0.4, 1.0)  # relative absorption of red, green and blue by varnish


def smudge(image: Array, random: Random) -> Array:
    """Smudge the paint in a picture (H, W, 3), float32 in [0, 1], by an amount that varies across the picture."""
    size = image.shape[:2]
    noise = gaussian_blur(random.standard_normal(size).astype(np.float32), random.uniform(8, 30))
    share = np.clip(0.5 + noise / max(noise.std(), 1e-6), 0, 1)[..., None] * np.float32(random.uniform(0.3, 1))
    sigma = random.uniform(0.8, 2.5)
    return image + share * (gaussian_blur(image, (sigma, sigma, 0)) - image)


def shine(image: Array, height: Array, random: Random) -> Array:
    """Light the relief (H, W) of the paint in a picture (H, W, 3) from a random direction."""
    light = Light(random.uniform(0, 360), random.uniform(25, 70), 1.0, random.uniform(0, 0.5))
    bumps = gaussian_blur(height, random.uniform(0.4, 1.0)) * random.uniform(0.3, 2.5)
    return np.clip(shade_picture(image.transpose(2, 0, 1), normals_of(bumps), light), 0, 1).transpose(1, 2, 0)


def crack(image: Array, random: Random) -> Array:
    """Draw a network of fine cracks on a picture (H, W, 3), along the borders of irregular cells."""
    from scipy.spatial import cKDTree  # noqa: PLC0415

    height, width = image.shape[:2]
    cell = random.uniform(15, 60)
    count = max(int(height * width / cell**2), 4)
    rows, columns = np.mgrid[:height, :width].astype(np.float32)
    bend_down, bend_right = (
        gaussian_blur(random.standard_normal((height, width)), 4) * 4 * cell / 10 for _ in range(2)
    )
    seeds = random.random((count, 2)) * [height, width]
    places = np.stack([rows + bend_down, columns + bend_right], -1).reshape(-1, 2)
    distances, _ = cKDTree(seeds).query(places, k=2)
    nearest, second = distances.T
    gap = (second - nearest).reshape(height, width)
    patchy = gaussian_blur(random.standard_normal((height, width)), 25)
    line = np.clip(1.3 - gap / random.uniform(0.6, 1.4), 0, 1) * (patchy > random.uniform(-0.03, 0.01))
    return (image * (1 - random.uniform(0.2, 0.7) * line[..., None])).astype(np.float32)


def weather(image: Array, random: Random, strength: float = 1.0) -> Array:
    """Simulate a photograph of a canvas: blur, weave, grain, noise, varnish and JPEG artefacts of random strength.

    ``strength`` multiplies the usual strength of weave, grain and noise.
    """
    height, width = image.shape[:2]
    sigma = random.uniform(0.2, 1.0)
    image = gaussian_blur(image, (sigma, sigma, 0))
    if random.random() < 0.8:
        depth = np.float32(strength * random.uniform(0.005, 0.045))
        image = image * (1 + depth * _weave(height, width, random)[..., None])
    if random.random() < 0.2:  # varnish is yellow and darkens
        image = image * (1 - random.uniform(0, 0.3) * np.array(VARNISH, np.float32))
    noise = random.standard_normal(image.shape, np.float32)
    image = image + noise * np.float32(strength * random.uniform(0, 0.012))
    image = np.clip(image, 0, 1)
    return compress_as_jpeg(image, int(random.integers(60, 95))) if random.random() < 0.8 else image


def _weave(height: int, width: int, random: Random) -> Array:
    """Draw a texture (H, W) of canvas threads and grain."""
    rows, columns = np.mgrid[:height, :width].astype(np.float32)
    period_x, period_y = random.uniform(2.8, 6, 2)
    offset_x, offset_y = random.uniform(0, 50, 2)
    grain = gaussian_blur(random.standard_normal((height, width), np.float32), 1.0)
    across = np.sin(2 * np.pi * (columns + offset_x) / period_x)
    down = np.sin(2 * np.pi * (rows + offset_y) / period_y)
    return across * down * random.uniform(0, 1.2) + grain * random.uniform(1, 3.2)
