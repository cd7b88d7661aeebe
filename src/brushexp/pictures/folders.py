"""The pictures of a folder, or of a pattern such as ``photos/*.jpg``, are found."""

import glob
import os

from brushexp.errors import UserError

PICTURES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".webp", ".bmp", ".gif")  # endings of files


def is_several(image: str) -> bool:
    """Test whether what was typed names a folder or, being no file, is a pattern."""
    path = os.path.expanduser(image)
    return os.path.isdir(path) or (not os.path.exists(path) and glob.has_magic(image) and "(" not in image)


def pictures_in(image: str) -> list[str]:
    """List the picture files that a folder holds, or a pattern names; UserError if there are none."""
    path = os.path.expanduser(image)
    pattern = os.path.join(glob.escape(path), "*") if os.path.isdir(path) else path
    paths = sorted(
        name for name in glob.glob(pattern, recursive=True) if name.lower().endswith(PICTURES) and os.path.isfile(name)
    )
    if not paths:
        raise UserError(f"image={image}: no picture is there; give a folder or pattern of {', '.join(PICTURES)}")
    return paths
