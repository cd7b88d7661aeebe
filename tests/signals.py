"""Reference formulas that encode linear light as the signals of several standards."""

import numpy as np

# Matrices from sRGB's primaries to other primaries by their chromaticities (CIE 15); rows are red, green, blue.
TO_ADOBE = [[0.71512, 0.28488, 0], [0, 1, 0], [0, 0.04117, 0.95883]]
TO_P3 = [[0.82246, 0.17754, 0], [0.03319, 0.96681, 0], [0.01708, 0.07240, 0.91052]]
TO_BT2020 = [[0.62740, 0.32928, 0.04331], [0.06910, 0.91954, 0.01136], [0.01639, 0.08801, 0.89559]]


def srgb(light: np.ndarray) -> np.ndarray:
    """Encode linear light as in sRGB (IEC 61966-2-1)."""
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * np.clip(light, 0, 1) ** (1 / 2.4) - 0.055)


def pq(light: np.ndarray) -> np.ndarray:
    """Encode light, in units of 203 nits, with the PQ curve of ITU-R BT.2100."""
    y = (203 * light / 10_000) ** 0.1593017578125
    return ((0.8359375 + 18.8515625 * y) / (1 + 18.6875 * y)) ** 78.84375


def hlg(light: np.ndarray) -> np.ndarray:
    """Encode light, in units of 203 nits, with the HLG curve of ITU-R BT.2100 for a 1000-nit display (gamma 1.2)."""
    shown = 0.203 * light
    luminance = (shown @ [0.2627, 0.6780, 0.0593])[..., None]
    scene = shown * luminance ** ((1 - 1.2) / 1.2)
    return np.where(
        scene <= 1 / 12, np.sqrt(3 * scene), 0.17883277 * np.log(np.maximum(12 * scene, 1) - 0.28466892) + 0.55991073
    )
