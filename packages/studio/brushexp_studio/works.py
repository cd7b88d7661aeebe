"""The paintings of a session: one at a time is painted, in a thread beside the page."""

import logging
import time
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path
from threading import Event, Thread
from typing import Any

from PIL import Image

import brushexp
from brushexp.errors import UserError
from brushexp.pages.html import encode
from brushexp_studio.photos import JPEG, in_plain_letters
from brushexp_studio.wishes import Wishes

log = logging.getLogger(__name__)
FRAME_SIDE = 1024  # pixels of the longer side of a frame
MOST_FRAMES = 120  # per painting; of more every second one is removed
PAINTING, FINISHING, DONE, FAILED = "painting", "finishing", "done", "failed"


@dataclass
class Work:
    """One painting: its pictures so far as JPEG, each with a caption."""

    number: int
    wishes: Wishes
    folder: Path
    status: str = PAINTING
    frames: dict[int, tuple[bytes, str]] = field(default_factory=dict)  # pictures and captions by number, in order
    trouble: str = ""  # what went wrong, in one line
    stopped: Event = field(default_factory=Event)

    @property
    def title(self) -> str:
        return f"{self.number} · {self.wishes.look}"

    @property
    def name(self) -> str:
        """The name of saved files, in letters that are valid on any system."""
        return in_plain_letters(f"{Path(self.wishes.subject.name).stem}-{self.wishes.look}-{self.number}")

    @property
    def ratio(self) -> float:
        """Width over height."""
        return self.wishes.subject.ratio

    @property
    def last(self) -> int:
        """The number of the latest picture; -1 before there is one."""
        return max(self.frames, default=-1)

    @property
    def address(self) -> str:
        """The address of the latest picture."""
        return f"/works/{self.number}/{self.last}.jpg"

    @property
    def files(self) -> list[Path]:
        """The files that can be downloaded."""
        return sorted(path for path in self.folder.rglob("*") if path.is_file()) if self.status == DONE else []

    def add_frame(self, image: Any, caption: str) -> None:
        """Add a picture (H, W, 3) of bytes."""
        self.frames[self.last + 1] = encode(Image.fromarray(image), FRAME_SIDE, **JPEG), caption
        if len(self.frames) > MOST_FRAMES:
            for other in list(self.frames)[1:-1:2]:
                del self.frames[other]


class Works:
    """All paintings of a session, in a folder; ``options`` are keys of the command line of all of them."""

    def __init__(self, folder: Path, options: dict[str, Any]) -> None:
        self.folder, self.options = folder, options
        self.all: list[Work] = []
        self.version = 0  # grows with every change that the page shows
        self.is_warm = Event()
        self._thread: Thread | None = None
        self._closing = Event()

    @property
    def current(self) -> Work | None:
        """The painting that is not finished."""
        busy = self.all and self.all[-1].status in (PAINTING, FINISHING)
        return self.all[-1] if busy else None

    def __getitem__(self, number: int) -> Work:
        """Return a painting by its number; KeyError if there is none."""
        return {work.number: work for work in self.all}[number]

    def warm_up(self) -> None:
        """Import and compile, in a thread, what the first painting needs."""
        self._thread = Thread(target=self._warm, name="warm-up", daemon=True)
        self._thread.start()

    def begin(self, wishes: Wishes) -> Work:
        """Begin to paint; a UserError if another painting is not finished."""
        if wishes.photo is None:
            raise UserError("choose a picture first")
        if self.current:
            raise UserError("one painting at a time: stop the one that is being painted, or wait for its end")
        number = len(self.all) + 1
        wishes = replace(wishes)  # later choices are for the next painting
        work = Work(number, wishes, self.folder / f"{datetime.now():%Y-%m-%d_%H-%M-%S}_{number}_{wishes.look}")
        self.all.append(work)
        self.version += 1
        self._thread = Thread(target=self._run, args=(work, self._thread), name="painting", daemon=True)
        self._thread.start()
        return work

    def close(self) -> None:
        """End the painting and the thread."""
        self._closing.set()
        if self.current:
            self.current.stopped.set()
        if self._thread:
            self._thread.join()

    def _warm(self) -> None:
        for look in ("oil", "plain"):  # their renderers are those of all looks
            if not self._closing.is_set():
                brushexp.paint("chelsea", look=look, resolution=48, steps=2, **self.options)
        self.is_warm.set()
        self.version += 1

    def _run(self, work: Work, before: Thread | None) -> None:
        if before:
            before.join()  # the warm-up
        try:
            self._paint(work)
            work.status = DONE
        except Exception as error:
            work.status = FAILED
            work.trouble = str(error) if isinstance(error, UserError) else f"this painting failed: {error}"
            log.log(logging.INFO if isinstance(error, UserError) else logging.ERROR, "%s", error, exc_info=True)
        self.version += 1

    def _paint(self, work: Work) -> None:
        wishes, start = work.wishes, time.monotonic()
        options = wishes.overrides() | self.options
        states = brushexp.iterate(wishes.subject.path, every=1, every_seconds=0.25, **options)
        for state in states:
            quality = f"{state.psnr:.1f} dB · {len(state.strokes):,} strokes · {time.monotonic() - start:.1f} s"
            work.add_frame(state.image, f"step {state.step} of {state.steps} · {quality}")
            self.version += 1
            if work.stopped.is_set() and state.painting is None:
                state.stop()
            if state.painting is not None:
                work.status = FINISHING
                self.version += 1
                if not self._closing.is_set():
                    state.painting.save(work.folder)
