"""Convert a user's choices to command-line overrides."""

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
    """A user's choices; a choice that is None is left to the look."""

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
        """The picture to paint; it must have been chosen."""
        assert self.photo is not None
        return self.photo

    @property
    def resolution(self) -> int:
        """The longer side of the canvas in pixels; small pictures are not enlarged."""
        return min(self.side, max(self.subject.size))

    @property
    def canvas(self) -> tuple[int, int]:
        """The height and width of the canvas in pixels."""
        return size_at(self.resolution, *self.subject.size)

    def overrides(self) -> dict[str, Any]:
        """Return the command-line overrides for these choices, without ``image``."""
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
        """Return the overrides for a preview that starts from predicted strokes.

        Returns None if the painting starts from predicted strokes anyway, or if no preview is possible.
        """
        drafted, own = (plugin_of(_settings(self.look, quality).init).name for quality in ("glance", "normal"))
        if drafted == own or self.size != 1 or self.touch or (self.seconds is None and self.quality == "draft"):
            return None
        return {key: value for key, value in self.overrides().items() if key != "seconds"} | {"quality": "glance"}

    def command(self) -> str:
        """Return the equivalent command line, in which the user's files appear by name only."""
        words = {"image": self.subject.name} | self.overrides()
        del words["frames"]
        if self.mask and words.get("focus") == str(self.mask):
            words |= {"focus": "mask.png", "faces": "mask.png"}
        if self.style is not None:
            words["style.image"] = self.style.name
        parts = [f"{key}={'null' if value is None else value}" for key, value in words.items()]
        return shlex.join(["brushexp", *parts])


def planned_strokes(wishes: Wishes) -> int:
    """Return the maximum number of strokes in the painting."""
    cfg = _settings(wishes.look, wishes.quality)
    return wishes.strokes or stroke_budget(cfg, wishes.canvas, build(cfg.density))


def own_size(look: str) -> dict[str, float]:
    """Return a look's stroke length and width in pitches, or {} if the strokes come from another painting."""
    cfg = _settings(look, "normal")
    if cfg.style.brushwork is not None:
        return {}
    return {name: cfg.init[name] for name in ("length", "width") if name in cfg.init}


@lru_cache(maxsize=64)
def _settings(look: str, quality: str) -> Any:
    """Compose the config of a look; the first call takes most of a second."""
    return settings_of("paint", {"look": look, "quality": quality}).cfg
