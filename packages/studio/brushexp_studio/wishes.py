"""Convert the choices of a user to overrides of the command line."""

import shlex
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from brushexp.contracts import build, plugin_of
from brushexp.contracts.painting import stroke_budget
from brushexp.contracts.pictures import size_at
from brushexp.contracts.runs import settings_of
from brushexp_studio.photos import Photo
from brushexp_studio.touches import Touch

QUALITIES = ("draft", "normal", "fine", "best")
SIDES = (256, 512, 768, 1024)  # pixels of the canvas
FOCUS = {"look": "Set by the look", "auto": "Faces first", "even": "Everywhere", "mask": "Painted by hand"}
AS_LOOK = ""  # leaves a choice to the look
PAPERS = {
    AS_LOOK: "Set by the look",
    "smooth": "None",
    "cold_pressed": "Cold pressed",
    "rough": "Rough",
    "laid": "Laid",
    "weave": "Canvas",
}
PALETTES = {
    AS_LOOK: "Set by the look",
    "own": "As the photograph",
    "high_key": "Light",
    "low_key": "Dark",
    "muted": "Muted",
}
TUBES = {
    AS_LOOK: "Any colour",
    "eight": "Eight acrylics",
    "acrylics": "Eleven acrylics",
    "primaries": "Primaries",
    "zorn": "Zorn's oils",
}
TUBES_LOOK = "tubes"  # look of a painting with tubes
LONGEST_STROKE = 10.0  # maximum init.length and init.width in pitches


@dataclass
class Wishes:
    """The choices of a user; None leaves a choice to the look."""

    photo: Photo | None = None  # None if no picture is chosen yet
    look: str = "oil"
    side: int = 512
    quality: str = "normal"
    seconds: float | None = None  # time limit that replaces the steps of a quality
    strokes: int | None = None
    size: float = 1.0  # factor on the length and width of strokes
    focus: str = "look"
    mask: Path | None = None  # focus mask painted by hand
    style: Photo | None = None
    paper: str = AS_LOOK
    palette: str = AS_LOOK
    tubes: str = AS_LOOK  # other values require `TUBES_LOOK`
    touch: Touch | None = None  # place of a finished painting to repaint

    @property
    def subject(self) -> Photo:
        """The picture to paint, which must have been chosen."""
        assert self.photo is not None
        return self.photo

    @property
    def resolution(self) -> int:
        """Longer side of the canvas in pixels; small pictures are not enlarged."""
        return min(self.side, max(self.subject.size))

    @property
    def canvas(self) -> tuple[int, int]:
        """Height and width of the canvas."""
        return size_at(self.resolution, *self.subject.size)

    def overrides(self) -> dict[str, Any]:
        """Convert to keys of the command line other than ``image``."""
        keys: dict[str, Any] = {"look": self.look, "resolution": self.resolution, "frames": 60}
        keys |= {"quality": self.quality} if self.seconds is None else {"seconds": self.seconds}
        if self.strokes is not None:
            keys["strokes"] = min(self.strokes, self.canvas[0] * self.canvas[1])
        if self.size != 1:
            own = own_size(self.look)
            keys |= {f"init.{name}": min(LONGEST_STROKE, value * self.size) for name, value in own.items()}
            keys |= {"init": plugin_of(_settings(self.look, "normal").init).name} if own else {}  # instead of a draft's
        if self.focus != "look":
            keys["focus"] = {"auto": "auto", "even": None, "mask": self.mask and str(self.mask)}[self.focus]
        if self.focus == "mask" and self.mask:
            keys["faces"] = str(self.mask)
        if self.style is not None:
            keys["style.image"] = str(self.style.path)
        for name in ("paper", "palette", "tubes"):
            if value := getattr(self, name):
                keys[name] = value
        return keys

    def at_a_glance(self) -> dict[str, Any] | None:
        """Convert to keys of a painting that starts from predicted strokes; None if it already does, or cannot."""
        drafted, own = (plugin_of(_settings(self.look, quality).init).name for quality in ("glance", "normal"))
        if drafted == own or self.size != 1 or self.touch or (self.seconds is None and self.quality == "draft"):
            return None
        return {key: value for key, value in self.overrides().items() if key != "seconds"} | {"quality": "glance"}

    def command(self) -> str:
        """Write the command line with the name of the user's file."""
        words = {"image": self.subject.name} | self.overrides()
        del words["frames"]
        if self.mask and words.get("focus") == str(self.mask):
            words |= {"focus": "mask.png", "faces": "mask.png"}
        if self.style is not None:
            words["style.image"] = self.style.name
        parts = [f"{key}={'null' if value is None else value}" for key, value in words.items()]
        return shlex.join(["brushexp", *parts])


def planned_strokes(wishes: Wishes) -> int:
    """Compute the maximum number of strokes of the painting."""
    cfg = _settings(wishes.look, wishes.quality)
    return wishes.strokes or stroke_budget(cfg, wishes.canvas, build(cfg.density))


def own_size(look: str) -> dict[str, float]:
    """Read the stroke length and width of a look in pitches; empty if they come from another painting."""
    cfg = _settings(look, "normal")
    if cfg.style.brushwork is not None:
        return {}
    return {name: cfg.init[name] for name in ("length", "width") if name in cfg.init}


@lru_cache(maxsize=64)
def _settings(look: str, quality: str) -> Any:
    """Compose the config of a look, which takes most of a second the first time."""
    return settings_of("paint", {"look": look, "quality": quality}).cfg
