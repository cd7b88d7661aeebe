"""HTML pages of runs and sweeps."""

from brushexp.pages.html import TEMPLATES, embed, encode, page
from brushexp.pages.replay import pack_strokes, pack_textures, textured_profile_of
from brushexp.pages.run_page import LARGEST_SIDE, PAGE_NAME, list_settings, page_in, run_page
from brushexp.pages.sweep_page import side_for, thumbnail, write_sweep_page

__all__ = [
    "LARGEST_SIDE",
    "PAGE_NAME",
    "TEMPLATES",
    "embed",
    "encode",
    "list_settings",
    "pack_strokes",
    "pack_textures",
    "page",
    "page_in",
    "run_page",
    "side_for",
    "textured_profile_of",
    "thumbnail",
    "write_sweep_page",
]
