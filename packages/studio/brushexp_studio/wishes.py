"""Choices of a visitor of the page, and the overrides of the command line that they are."""

import shlex
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from brushexp.api.settings import settings_of
from brushexp.painting.components import stroke_budget
from brushexp.registry import build
from brushexp_studio.photos import Photo

QUALITIES = ("draft", "normal", "fine", "best")
SIDES = (256, 512, 768, 1024)  # pixels of the canvas
FOCUS = {"look": "As the look", "auto": "Faces first", "even": "Everywhere", "mask": "Painted by hand"}
LONGEST_STROKE = 10.0  # pitches: what init.length and init.width take
FRAMES = 60  # of the film that a painting leaves


@dataclass
class Wishes:
    """Choices of one visitor; what is None is left to the look."""

    photo: Photo | None = None  # None: nothing is chosen yet
    look: str = "oil"
    side: int = 512
    quality: str = "normal"
    seconds: float | None = None  # instead of the steps of a quality
    strokes: int | None = None
    size: float = 1.0  # factor of the strokes' length and width
    focus: str = "look"
    mask: Path | None = None  # painted by hand
    style: Photo | None = None

    @property
    def painted(self) -> Photo:
        """The picture, which must be chosen."""
        assert self.photo is not None
        return self.photo

    @property
    def resolution(self) -> int:
        """The longer side of the canvas: small pictures are not enlarged."""
        return min(self.side, max(self.painted.size))

    @property
    def canvas(self) -> tuple[int, int]:
        """Height and width of the canvas."""
        height, width = (max(1, round(side * self.resolution / max(self.painted.size))) for side in self.painted.size)
        return height, width

    def overrides(self) -> dict[str, Any]:
        """Keys of the command line besides ``image``."""
        found: dict[str, Any] = {"look": self.look, "resolution": self.resolution, "frames": FRAMES}
        found |= {"quality": self.quality} if self.seconds is None else {"seconds": self.seconds}
        if self.strokes is not None:
            found["strokes"] = min(self.strokes, self.canvas[0] * self.canvas[1])
        if self.size != 1:
            own = own_size(self.look)
            found |= {f"init.{name}": min(LONGEST_STROKE, value * self.size) for name, value in own.items()}
        if self.focus != "look":
            found["focus"] = {"auto": "auto", "even": None, "mask": self.mask and str(self.mask)}[self.focus]
        if self.style is not None:
            found["style.image"] = str(self.style.path)
        return found

    def command(self) -> str:
        """The same for a terminal, with the name of the photograph as the visitor knows it."""
        words = {"image": self.painted.name} | self.overrides()
        del words["frames"]
        if self.mask and words.get("focus") == str(self.mask):
            words["focus"] = "mask.png"
        if self.style is not None:
            words["style.image"] = self.style.name
        typed = [f"{key}={'null' if value is None else value}" for key, value in words.items()]
        return shlex.join(["brushexp", *typed])


def planned_strokes(wishes: Wishes) -> int:
    """How many strokes the painting will have, at most."""
    cfg = _settings(wishes.look, wishes.quality)
    return wishes.strokes or stroke_budget(cfg, wishes.canvas, build(cfg.density))


def own_size(look: str) -> dict[str, float]:
    """Length and width of strokes that a look has, in pitches; empty where they come from another painting."""
    cfg = _settings(look, "normal")
    if cfg.style.brushwork is not None:
        return {}
    return {name: cfg.init[name] for name in ("length", "width") if name in cfg.init}


@lru_cache(maxsize=64)
def _settings(look: str, quality: str) -> Any:
    """The config of a painting with a look: it takes most of a second the first time."""
    return settings_of("paint", {"look": look, "quality": quality}).cfg
