"""Render templates as self-contained pages whose content security policy forbids all outside sources."""

import base64
import hashlib
import io
import math
from functools import cache
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup
from PIL import Image

from brushexp import __version__
from brushexp.system.files import PNG

TEMPLATES = Path(__file__).parent / "templates"


def page(template: str, folder: Path = TEMPLATES, **context: Any) -> str:
    """Render a template in ``folder`` as a complete page; the result is deterministic.

    Templates in other folders can also use the templates in ``TEMPLATES``. Values are escaped, and a missing name is an
    error. ``{{ assets["page.css"] }}`` inserts a file from either folder. The content security policy allows only these
    files and embedded pictures; it forbids ``style`` and ``onclick`` attributes.
    """
    return _environment(folder).get_template(template).render(**context)


@cache
def _environment(folder: Path) -> Environment:
    folders = dict.fromkeys((TEMPLATES, folder))
    policy = ["default-src 'none'; img-src data:; base-uri 'none'; form-action 'none'"]
    assets: dict[str, Markup] = {}
    for tag, suffix in (("style", "css"), ("script", "js")):
        paths = [path for each in folders for path in sorted(each.glob(f"*.{suffix}"))]
        texts = {path.name: path.read_text(encoding="utf-8") for path in paths}
        digests = [base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() for text in texts.values()]
        policy.append(" ".join([f"{tag}-src", *(f"'sha256-{digest}'" for digest in digests)]))
        assets |= {name: Markup(f"<{tag}>{text}</{tag}>") for name, text in texts.items()}
    loader = FileSystemLoader(list(folders))
    jinja = Environment(loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    jinja.globals |= {"policy": Markup("; ".join(policy)), "assets": assets, "version": __version__}
    jinja.filters["number"] = readable_number
    return jinja


def readable_number(value: object, digits: int = 0) -> str:
    """Format a number like 12,345.6; infinity becomes ∞, and anything that is not a number becomes a dash."""
    if not isinstance(value, int | float) or math.isnan(value):
        return "–"
    return f"{value:,.{digits}f}" if math.isfinite(value) else "∞" if value > 0 else "−∞"


def encode(picture: Image.Image, largest: int, **options: Any) -> bytes:
    """Encode a picture with Pillow, after shrinking it in place to at most ``largest`` pixels on its longer side."""
    picture.thumbnail((largest, largest), Image.Resampling.LANCZOS, reducing_gap=3.0)
    file = io.BytesIO()
    picture.save(file, **options)
    return file.getvalue()


def embed(picture: Image.Image, largest: int, **options: Any) -> dict[str, Any]:
    """Embed a picture as a PNG, or as ``options`` specify; return its ``source``, ``width`` and ``height``."""
    options = options or PNG
    letters = base64.b64encode(encode(picture, largest, **options)).decode()
    source = f"data:image/{options['format'].lower()};base64,{letters}"
    return {"source": source, "width": picture.width, "height": picture.height}
