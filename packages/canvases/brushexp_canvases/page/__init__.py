"""The page that shows a pyramid from a folder: pan and zoom, the painting and its target under a curtain."""

from pathlib import Path

from brushexp.pages.html import page
from brushexp.system.files import write_text
from brushexp_canvases.pyramid import TILE

TEMPLATES = Path(__file__).parent / "templates"
PAGE_NAME = "view.html"


def write_page(folder: Path, size: tuple[int, int], names: list[str], title: str, lead: str) -> Path:
    """Write ``view.html``, which shows the Deep Zoom images ``names`` beside it, of ``size`` (H, W), from disk."""
    data = {"height": size[0], "width": size[1], "tile": TILE, "names": names}
    write_text(path := folder / PAGE_NAME, page("view.html.j2", TEMPLATES, title=title, lead=lead, data=data))
    return path
