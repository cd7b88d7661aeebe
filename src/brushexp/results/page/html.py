"""Templates to pages: everything a page needs is written into it, and its content security policy allows no more."""

from __future__ import annotations

import base64
import hashlib
import io
import math
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image

if TYPE_CHECKING:
    from jinja2 import Environment
    from markupsafe import Markup

TEMPLATES = Path(__file__).parent / "templates"
POLICY_MARK = "@policy@"  # stands in base.html.j2 before any text of a user
LARGEST_SIDE = 1600  # pixels of the longer side of a picture in a page
LARGEST_FILE = 500_000  # bytes of a PNG: a larger one goes into a page as a JPEG
JPEG_QUALITY = 92  # with colours at full resolution
MEDIA_TYPES = {"PNG": "image/png", "JPEG": "image/jpeg", "WEBP": "image/webp", "GIF": "image/gif"}


def page(template: str, **context: Any) -> str:
    """A whole page; the same for the same context.

    Templates escape what they show. They write files of this folder into the page with ``{{ style("page.css") }}`` and
    ``{{ script("pieces.js") }}``. The policy allows only what has the hashes of these files, and pictures that are in
    the page itself; so neither ``style`` nor ``onclick`` attributes work in a template.

    Args:
        template: name of a file in ``templates``; pages extend ``base.html.j2``.
        context: what it shows; a name that is missing is an error.
    """
    from markupsafe import Markup  # noqa: PLC0415  (slow imports are not for --help)

    hashes: dict[str, list[str]] = {"style": [], "script": []}

    def inlined(tag: str, names: tuple[str, ...]) -> Markup:
        text = "\n".join(_asset(name) for name in names)
        digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
        hashes[tag].append(f"'sha256-{digest}'")
        return Markup(f"<{tag}>{text}</{tag}>")  # files of this package

    html = (
        _environment()
        .get_template(template)
        .render(
            style=lambda *names: inlined("style", names),
            script=lambda *names: inlined("script", names),
            policy=POLICY_MARK,
            version=version("brushexp"),
            **context,
        )
    )
    sources = "; ".join(f"{tag}-src {' '.join(found)}" for tag, found in hashes.items())
    policy = f"default-src 'none'; img-src data:; {sources}; base-uri 'none'; form-action 'none'"
    return html.replace(POLICY_MARK, policy, 1)


@cache
def _environment() -> Environment:
    """Jinja with the filters of the pages; it escapes everything, and knows no undefined names."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined  # noqa: PLC0415

    made = Environment(
        loader=FileSystemLoader(TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.filters["number"] = readable_number
    return made


@cache
def _asset(name: str) -> str:
    """A style or script of ``templates``."""
    return (TEMPLATES / name).read_text(encoding="utf-8")


def readable_number(value: object, digits: int = 0) -> str:
    """A number as people read it, 12,345.6; infinity as a sign; None and NaN as a dash."""
    if not isinstance(value, int | float) or math.isnan(value):
        return "–"
    return f"{value:,.{digits}f}" if math.isfinite(value) else "∞" if value > 0 else "−∞"


def data_uri(picture: bytes | np.ndarray | Image.Image, format: str = "PNG", **options: Any) -> str:
    """A picture as a source for ``<img>`` that is in the page itself.

    Args:
        picture: an encoded file; or pixels (H, W) or (H, W, 3) uint8, or a Pillow picture, to be encoded.
        format: PNG, JPEG, WEBP or GIF: what the file is, or shall be.
        options: for Pillow's encoder.
    """
    if not isinstance(picture, bytes):
        image = Image.fromarray(picture) if isinstance(picture, np.ndarray) else picture
        file = io.BytesIO()
        image.save(file, format=format, **options)
        picture = file.getvalue()
    return f"data:{MEDIA_TYPES[format]};base64,{base64.b64encode(picture).decode()}"


def picture_uri(picture: Path | np.ndarray) -> str:
    """A picture, a file or pixels (H, W, 3) uint8, as it goes into a page: a small file as it is, others encoded anew.

    One with more than ``LARGEST_SIDE`` pixels on a side is shrunk, and one of many pixels becomes a JPEG.
    """
    if isinstance(picture, Path):
        with Image.open(picture) as opened:
            format = str(opened.format)
            small = max(opened.size) <= LARGEST_SIDE and picture.stat().st_size <= LARGEST_FILE
            if small and format in MEDIA_TYPES:
                return data_uri(picture.read_bytes(), format)
            picture = np.asarray(opened.convert("RGB"))
    image = downscaled(Image.fromarray(picture), LARGEST_SIDE)
    if image.width * image.height <= LARGEST_FILE // 3:
        return data_uri(image)
    return data_uri(image, "JPEG", quality=JPEG_QUALITY, subsampling=0)


def downscaled(picture: Image.Image, largest: int) -> Image.Image:
    """The picture with at most so many pixels on its longer side."""
    zoom = largest / max(picture.size)
    if zoom >= 1:
        return picture
    size = (max(1, round(picture.width * zoom)), max(1, round(picture.height * zoom)))
    return picture.resize(size, Image.Resampling.LANCZOS, reducing_gap=3.0)
