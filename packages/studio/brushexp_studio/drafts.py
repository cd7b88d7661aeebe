"""Paint small drafts of the chosen photograph, one in each look, in the background."""

import logging
import os
import sys
from contextlib import closing
from threading import Event, Thread, get_native_id
from typing import Any

from PIL import Image

import brushexp
from brushexp.contracts import UserError
from brushexp.contracts.pages import encode
from brushexp_studio.photos import JPEG, Photo
from brushexp_studio.works import Works

log = logging.getLogger(__name__)
SIDE = 192  # longer side of a draft in pixels
MOST_DRAFTS = 300  # maximum number of drafts kept; the oldest are dropped
PAUSE = 0.3  # seconds between two checks for work
NICENESS = 10  # niceness of the thread on systems with niceness per thread


class Drafts:
    """Drafts of photographs in different looks, painted one at a time while no painting is in progress or waiting."""

    def __init__(self, works: Works) -> None:
        self.works = works
        self.pictures: dict[tuple[str, str], bytes] = {}  # JPEGs by photograph and look; empty if a look failed
        self._wanted: tuple[Photo, list[str]] | None = None
        self._closing = Event()
        self._thread: Thread | None = None

    def want(self, photo: Photo, looks: list[str]) -> None:
        """Request drafts of a photograph in the given looks, in this order; earlier requests are dropped."""
        self._wanted = photo, looks
        if self._thread is None:
            self._thread = Thread(target=self._run, name="drafts", daemon=True)
            self._thread.start()

    def address(self, photo: Photo | None, look: str) -> str | None:
        """Return the address of a draft, or None if the draft does not exist."""
        return f"/drafts/{photo.key}/{look}.jpg" if photo and self.pictures.get((photo.key, look)) else None

    def close(self) -> None:
        """Abort the current draft and end the thread."""
        self._closing.set()
        if self._thread:
            self._thread.join()

    def _run(self) -> None:
        if sys.platform == "linux":
            os.setpriority(os.PRIO_PROCESS, get_native_id(), NICENESS)
        while not self._closing.is_set():
            draft = self._next()
            if draft is None or not self._may_paint():
                self._closing.wait(PAUSE)
                continue
            with self.works.easel:
                picture = self._paint(*draft)
            if picture is not None:
                self.pictures[draft[0].key, draft[1]] = picture
                for key in list(self.pictures)[:-MOST_DRAFTS]:
                    del self.pictures[key]
                self.works.version += 1

    def _next(self) -> tuple[Photo, str] | None:
        """Return the photograph and look of the next draft, or None if all requested drafts are finished."""
        if self._wanted is None:
            return None
        photo, looks = self._wanted
        return next(((photo, look) for look in looks if (photo.key, look) not in self.pictures), None)

    def _may_paint(self) -> bool:
        return self.works.is_warm.is_set() and self.works.current is None and not self._closing.is_set()

    def _paint(self, photo: Photo, look: str) -> bytes | None:
        """Paint a draft; return None if more urgent work interrupts it, and empty bytes if the look fails."""
        keys: dict[str, Any] = {"look": look, "quality": "draft", "resolution": min(SIDE, max(photo.size))}
        try:
            if not self._may_paint():
                return None
            painter: Any = brushexp.iterate(photo.path, **keys | self.works.options)
            with closing(painter) as states:
                for state in states:
                    if not self._may_paint() or self._wanted is None or self._wanted[0] is not photo:
                        return None
                    image = state.image
        except UserError as error:
            log.info("the draft of look=%s failed: %s", look, error)
            return b""
        return encode(Image.fromarray(image), SIDE, **JPEG)
