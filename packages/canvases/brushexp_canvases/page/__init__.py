"""The page that shows a pyramid from a folder: pan and zoom, layers under a curtain, strokes as shapes when near."""

from pathlib import Path
from typing import Any

from brushexp.pages.html import page
from brushexp.system.files import write_text
from brushexp_canvases.pyramid import TILE

TEMPLATES = Path(__file__).parent / "templates"
PAGE_NAME = "view.html"


def write_page(
    folder: Path, size: tuple[int, int], names: list[str], title: str, lead: str, strokes: dict[str, Any] | None = None
) -> Path:
    """Write ``view.html``, which shows the Deep Zoom images ``names`` beside it, of ``size`` (H, W), from disk.

    The first is the painting; ``target`` may be one of the others. ``strokes`` are as `write_strokes` says.
    """
    layers = [*names[1:], *(["difference"] if "target" in names else [])]
    data = {"height": size[0], "width": size[1], "tile": TILE, "names": names, "strokes": strokes}
    text = page("view.html.j2", TEMPLATES, title=title, lead=lead, layers=layers, data=data)
    write_text(path := folder / PAGE_NAME, text)
    return path
