"""Paint the small samples of looks shown in the studio, from one photograph: ``python docs/site/look_samples.py``."""

from pathlib import Path

from PIL import Image

import brushexp
from brushexp.config.looks import look_names
from brushexp.config.publish import prepare

FOLDER = Path(__file__).parents[2] / "packages/studio/brushexp_studio/looks"
PHOTO, RESOLUTION = "astronaut", 340  # pixels of the longer side: few, so that strokes are seen
FACE = (69, 8, 229, 168)  # left, top, right and bottom of what is shown, in pixels
SIDE, QUALITY = 176, 80  # pixels, and of WebP


def paint_samples(looks: list[str]) -> None:
    """Paint the photograph in each look, and write the results as ``<look>.webp``."""
    for look in looks:
        painting = brushexp.paint(PHOTO, look=look, resolution=RESOLUTION)
        picture = Image.fromarray(painting.image).crop(FACE).resize((SIDE, SIDE), Image.Resampling.LANCZOS)
        picture.save(FOLDER / f"{look}.webp", quality=QUALITY, method=6)


if __name__ == "__main__":
    prepare(Path())
    paint_samples(look_names())
