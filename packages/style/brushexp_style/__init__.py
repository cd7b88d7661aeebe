"""Losses that bring a painting nearer to another one: its style, and its brushwork (``style=``)."""

from brushexp_style import brushwork, style

__all__ = ["brushwork", "style"]
