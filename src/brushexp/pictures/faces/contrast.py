"""Restore the forms of eyes and mouths that a reduced palette has flattened."""

from collections.abc import Sequence

import numpy as np
from torch import Tensor

from brushexp.pictures.color import as_lab, as_picture

BLUR = 0.7  # radii of a place, deviation of the Gaussian that separates its forms from its tone
FULL, NONE = 1.0, 1.6  # radii of a place, distances from its middle up to which forms are restored fully, and at all
MOST_GAIN = 1.8  # most that the forms of the picture are strengthened
SMALL = 16.0  # pixels, radius of a place below which forms are strengthened, in proportion, to be seen among strokes
MOST_EMPHASIS = 1.5  # most that they are strengthened for this
EVEN = 0.5  # deviation of L* of a place below which it has no forms

Place = tuple[float, float, float]  # x, y and radius in pixels


def restore_forms(target: Tensor, picture: Tensor, places: Sequence[Place], *, hues: bool = True) -> Tensor:
    """Restore the forms of ``picture`` in round areas of its reduced-palette version ``target``, both (3, H, W).

    The forms of a picture are the difference between its CIELAB values and a blurred copy of them. The new lightness is
    the target's blurred lightness plus the forms of ``picture``. These are amplified if the target's forms are
    stronger, and amplified further in small areas. Colours change only in dark areas, such as lips, where the palette
    has weakened them, and not at all without ``hues``.
    """
    restored = target.clone()
    for x, y, radius in places:
        _restore(restored, picture, (x, y, radius), hues)
    return restored


def _restore(target: Tensor, picture: Tensor, place: Place, hues: bool) -> None:
    from scipy.ndimage import gaussian_filter  # noqa: PLC0415  (slow to import)

    x, y, radius = place
    height, width = target.shape[1:]
    reach = NONE * radius + 3 * BLUR * radius
    top, left = max(0, round(y - reach)), max(0, round(x - reach))
    bottom, right = min(height, round(y + reach)), min(width, round(x + reach))
    if top >= bottom or left >= right:
        return
    rows, columns = np.ogrid[top:bottom, left:right]
    distance = np.hypot(rows + 0.5 - y, columns + 0.5 - x) / radius
    share = ((NONE - distance) / (NONE - FULL)).clip(0, 1)[..., None]
    own, toned = (as_lab(one[:, top:bottom, left:right]) for one in (picture, target))
    own_forms, forms = (one - gaussian_filter(one, (BLUR * radius, BLUR * radius, 0)) for one in (own, toned))
    inside = distance < FULL
    weak, strong = (one[..., 0][inside].std() if inside.any() else 0.0 for one in (own_forms, forms))
    if weak < EVEN:
        return
    # lights keep their colour: white teeth
    is_lost = hues & (np.abs(own_forms) > np.abs(forms)) & (own_forms[..., :1] < 0)
    wanted = np.where(is_lost, own_forms, forms)
    gain = max(strong / weak, 1) * min(max(SMALL / radius, 1), MOST_EMPHASIS)
    wanted[..., 0] = min(gain, MOST_GAIN) * own_forms[..., 0]
    lab = toned + share * (wanted - forms)
    target[:, top:bottom, left:right] = as_picture(lab)
