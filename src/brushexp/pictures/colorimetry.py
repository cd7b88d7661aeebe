"""Convert a file's samples to sRGB, using the primaries and the transfer curve that the file declares (ITU-T H.273)."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

Array = np.ndarray
Curve = Callable[[Array], Array]  # numbers in [0, 1] -> light, where 1 is white

D65, THEATRE, EQUAL = (0.3127, 0.3290), (0.314, 0.351), (1 / 3, 1 / 3)
BT709 = ((0.640, 0.330), (0.300, 0.600), (0.150, 0.060), D65)  # red, green, blue and white, the same as those of sRGB
BT2020 = ((0.708, 0.292), (0.170, 0.797), (0.131, 0.046), D65)
P3 = ((0.680, 0.320), (0.265, 0.690), (0.150, 0.060))
SMPTE_C = ((0.630, 0.340), (0.310, 0.595), (0.155, 0.070), D65)
PRIMARIES = {  # keys are numbers of H.273, table 2
    1: BT709,
    4: ((0.67, 0.33), (0.21, 0.71), (0.14, 0.08), (0.310, 0.316)),
    5: ((0.64, 0.33), (0.29, 0.60), (0.15, 0.06), D65),
    6: SMPTE_C,
    7: SMPTE_C,
    9: BT2020,
    10: ((1, 0), (0, 1), (0, 0), EQUAL),
    11: (*P3, THEATRE),
    12: (*P3, D65),
    22: ((0.630, 0.340), (0.295, 0.605), (0.155, 0.077), D65),
}
BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])
WHITE_NITS = 203.0  # reference white in a picture of high dynamic range, candela per square metre (ITU-R BT.2408)
HIGH_RANGE = (16, 18)  # H.273 numbers of transfer curves of high dynamic range: PQ and HLG
HLG_NITS, HLG_GAMMA = 1000.0, 1.2  # display for HLG according to BT.2100
ROWS = 256  # rows converted at once
SAME_WITHIN = 0.002  # coordinates and exponents closer than this are considered equal


@dataclass(frozen=True)
class Encoding:
    """Colour encoding of a picture: chromaticities (x, y) of red, green, blue and white, and the transfer curve."""

    primaries: tuple[tuple[float, float], ...]
    curve: Curve

    def to_srgb(self, picture: Array) -> Array:
        """Convert a picture (H, W, 3), uint8 or in [0, 1], to sRGB of the same dtype, clipping values above white.

        The white point is adapted to the sRGB white point (Bradford), so that grey stays grey.
        """
        matrix = (np.linalg.inv(_to_xyz(BT709)) @ _adaptation_of(self.primaries[3]) @ _to_xyz(self.primaries)).T
        result = np.empty_like(picture)
        for top in range(0, len(picture), ROWS):
            rows = picture[top : top + ROWS]
            light = self.curve(rows.astype(np.float32) / (255 if picture.dtype == np.uint8 else 1))
            color = encode_srgb((light @ matrix.astype(np.float32)).clip(0, 1))
            result[top : top + ROWS] = np.rint(255 * color) if picture.dtype == np.uint8 else color
        return result


def encode_srgb(light: Array) -> Array:
    """Encode linear light in [0, 1] as sRGB (IEC 61966-2-1)."""
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * np.maximum(light, 0.0031308) ** (1 / 2.4) - 0.055)


def decode_srgb(value: Array) -> Array:
    """Decode sRGB values to linear light, inverting `encode_srgb`."""
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def gamma(exponent: float) -> Curve:
    """Return the power-law transfer curve with this exponent."""
    return lambda value: value**exponent


def decode_pq(value: Array) -> Array:
    """Decode the perceptual quantizer (SMPTE ST 2084, BT.2100) to light in units of the reference white."""
    m1, m2, c1, c2, c3 = 2610 / 16384, 2523 / 32, 3424 / 4096, 2413 / 128, 2392 / 128
    power = value ** (1 / m2)
    return 10_000 / WHITE_NITS * (np.maximum(power - c1, 0) / (c2 - c3 * power)) ** (1 / m1)


def decode_hlg(value: Array) -> Array:
    """Decode hybrid log-gamma (BT.2100) for a 1000-nit display to light in units of the reference white."""
    a, b, c = 0.17883277, 0.28466892, 0.55991073
    scene = np.where(value <= 0.5, value**2 / 3, (np.exp((value - c) / a) + b) / 12)
    luminance = scene @ np.array([0.2627, 0.6780, 0.0593], np.float32)
    return HLG_NITS / WHITE_NITS * scene * np.maximum(luminance, 1e-9)[..., None] ** (HLG_GAMMA - 1)


CURVES: dict[int, Curve] = {  # keys are numbers of H.273, table 3; video with BT.709's curve is shown with sRGB's
    4: gamma(2.2),
    5: gamma(2.8),
    8: lambda value: value,
    16: decode_pq,
    17: lambda value: 52.37 / 48 * value**2.6,
    18: decode_hlg,
}
SRGB = Encoding(BT709, decode_srgb)
ADOBE_RGB = Encoding(((0.64, 0.33), (0.21, 0.71), (0.15, 0.06), D65), gamma(563 / 256))  # Adobe RGB (1998)


def encoding_of(primaries: int, transfer: int) -> Encoding:
    """Return the encoding for two H.273 code points; unknown ones mean sRGB, or BT.2020 primaries with HLG or PQ."""
    unsaid = BT2020 if transfer in HIGH_RANGE else BT709
    return Encoding(PRIMARIES.get(primaries, unsaid), CURVES.get(transfer, decode_srgb))


def unless_srgb(encoding: Encoding) -> Encoding | None:
    """Return an encoding, or None if it is sRGB, so that sRGB pictures stay bit-identical.

    The chromaticities of video standards before BT.709 are treated as sRGB, because players show them that way.
    """
    near = any(np.allclose(encoding.primaries, known, atol=SAME_WITHIN) for known in (BT709, PRIMARIES[5], SMPTE_C))
    return None if near and encoding.curve is decode_srgb else encoding


def _to_xyz(primaries: tuple[tuple[float, float], ...]) -> Array:
    """Compute the matrix (3, 3) that converts linear RGB to CIE XYZ, with white at Y = 1."""
    columns = np.array([[x, y, 1 - x - y] for x, y in primaries]).T
    white = columns[:, 3] / columns[1, 3]
    return columns[:, :3] * np.linalg.solve(columns[:, :3], white)


def _adaptation_of(white: tuple[float, float]) -> Array:
    """Compute the XYZ matrix (3, 3) that adapts a white point to the sRGB white point (Lam, 1985, "Bradford")."""
    ours, theirs = (BRADFORD @ np.array([x / y, 1, (1 - x - y) / y]) for x, y in (D65, white))
    return np.linalg.inv(BRADFORD) @ np.diag(ours / theirs) @ BRADFORD
