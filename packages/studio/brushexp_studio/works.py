"""Paint a session's paintings one at a time in a thread; further paintings wait in a queue."""

import io
import logging
import time
from contextlib import closing
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path
from threading import Event, Lock, Thread
from typing import Any

from PIL import Image

import brushexp
from brushexp.contracts import UserError
from brushexp.contracts.pages import encode
from brushexp_studio.downloads import BROKEN, FORMS, MADE, MAKING, PRINTS, Download, Stopped, make_file
from brushexp_studio.photos import JPEG, portable_name
from brushexp_studio.plans import Plan
from brushexp_studio.prints import Print
from brushexp_studio.touches import TOO_SMALL, lay_fresh_strokes, overrides_of
from brushexp_studio.wishes import Wishes

log = logging.getLogger(__name__)
FRAME_SIDE = 1024  # longer side of a frame in pixels
MOST_FRAMES = 120  # maximum number per painting, above which every second frame is removed
GLANCE = -1  # number of the predicted picture that is shown before a painting's first picture
WITHDRAWN = "withdrawn"  # status of a painting that was stopped before it began
LONGEST_QUEUE = 20  # maximum number of waiting paintings
WAITING, PAINTING, FINISHING, DONE, FAILED = "waiting", "painting", "finishing", "done", "failed"


@dataclass
class Work:
    """A painting with its choices, its state, its files, and its intermediate pictures (JPEGs with captions)."""

    number: int
    wishes: Wishes
    folder: Path
    owner: Any = None  # visit that started the painting
    status: str = WAITING
    frames: dict[int, tuple[bytes, str]] = field(default_factory=dict)  # pictures and captions by number, in order
    trouble: str = ""  # error in one line
    stopped: Event = field(default_factory=Event)
    share: float = 0.0  # finished share of the work, 0 to 1
    seconds_left: float | None = None
    painting: Any = None  # finished `brushexp.Painting`
    downloads: dict[str, Download] = field(default_factory=dict)  # requested files by form

    @property
    def is_open(self) -> bool:
        """Whether the painting is unfinished."""
        return self.status in (WAITING, PAINTING, FINISHING)

    @property
    def title(self) -> str:
        touch = self.wishes.touch
        return f"{self.number} · {self.wishes.look}" + (f", {touch.how}" if touch else "")

    @property
    def name(self) -> str:
        """The stem of the names under which files are saved; it is valid on every system."""
        return portable_name(f"{Path(self.wishes.subject.name).stem}-{self.wishes.look}-{self.number}")

    @property
    def ratio(self) -> float:
        """The ratio of width to height."""
        return self.wishes.subject.ratio

    @property
    def last(self) -> int:
        """The number of the latest picture, or -1 if there is none."""
        return max(self.frames, default=GLANCE)

    @property
    def address(self) -> str:
        """The address of the latest picture."""
        return f"/works/{self.number}/{self.last}.jpg"

    @property
    def files(self) -> dict[str, Path]:
        """The downloadable files in the painting's folder, by relative path."""
        if self.status != DONE:
            return {}
        paths = sorted(path for path in self.folder.rglob("*") if path.is_file())
        names = {path.relative_to(self.folder): path for path in paths}
        return {str(name): path for name, path in names.items() if name.parts[0] != PRINTS}

    @property
    def has_tubes(self) -> bool:
        """Whether the painting is finished and uses real paints."""
        return self.painting is not None and "tubes" in self.painting.settings.cfg.change

    def blend(self, percent: int) -> bytes:
        """Blend the painting over its photograph at 0 to 100 percent opacity, as the page does; return a PNG."""
        with Image.open(self.files["painting.png"]) as picture:
            painting = picture.convert("RGB")
        with Image.open(self.wishes.subject.path) as picture:
            photograph = picture.convert("RGB").resize(painting.size, Image.Resampling.LANCZOS)
        file = io.BytesIO()
        Image.blend(photograph, painting, min(max(percent, 0), 100) / 100).save(file, "PNG")
        return file.getvalue()

    def jpeg(self, number: int) -> bytes:
        """Return a picture by number, or the next one if it has been removed; raise KeyError if there is none."""
        frames = dict(self.frames)  # the painting thread continues
        later = [other for other in frames if other >= number]
        return frames[min(later, default=number)][0]

    def add_frame(self, image: Any, caption: str, number: int | None = None) -> None:
        """Add a picture (H, W, 3), uint8, under the given ``number``, or under the next number if None is given."""
        number = self.last + 1 if number is None else number
        self.frames[number] = encode(Image.fromarray(image), FRAME_SIDE, **JPEG), caption
        if len(self.frames) > MOST_FRAMES:
            for other in list(self.frames)[1:-1:2]:
                del self.frames[other]


class Works:
    """All paintings of a session, stored in a folder; ``options`` are overrides that apply to every painting."""

    def __init__(self, folder: Path, options: dict[str, Any]) -> None:
        self.folder, self.options = folder, options
        self.all: list[Work] = []
        self.count = 0  # number of paintings started
        self.version = 0  # increases with every change that the page shows
        self.is_warm = Event()
        self.easel = Lock()  # only one picture, painting or draft, is painted at a time
        self._thread: Thread | None = None
        self._closing = Event()
        self._making = Lock()  # only one file is made at a time
        self._makers: list[Thread] = []

    @property
    def current(self) -> Work | None:
        """The painting in progress, or otherwise the first one in the queue."""
        return next((work for work in self.all if work.is_open), None)

    def before(self, work: Work) -> int:
        """Count the unfinished paintings that were queued before this one."""
        return sum(other.is_open and other.number < work.number for other in self.all)

    def __getitem__(self, number: int) -> Work:
        """Return the painting with the given number; raise KeyError if it does not exist."""
        return {work.number: work for work in self.all}[number]

    def warm_up(self) -> None:
        """Import and compile the code that the first painting needs, in a background thread."""
        self._thread = Thread(target=self._warm, name="warm-up", daemon=True)
        self._thread.start()

    def begin(self, wishes: Wishes, owner: Any = None) -> Work:
        """Queue a painting; raise UserError if no picture is chosen or the queue is full."""
        if wishes.photo is None:
            raise UserError("choose a picture first")
        if sum(work.is_open for work in self.all) > LONGEST_QUEUE:
            raise UserError(f"{LONGEST_QUEUE} paintings are waiting; wait until one is finished")
        number = self.count = self.count + 1
        wishes = replace(wishes)  # later choices apply to the next painting
        folder = self.folder / f"{datetime.now():%Y-%m-%d_%H-%M-%S}_{number}_{wishes.look}"
        work = Work(number, wishes, folder, owner)
        self.all.append(work)
        self.version += 1
        self._thread = Thread(target=self._run, args=(work, self._thread), name="painting", daemon=True)
        self._thread.start()
        return work

    def stop(self, work: Work) -> None:
        """Stop a painting and keep its result so far, or remove it from the queue if it has not begun."""
        work.stopped.set()
        if work.status == WAITING:
            work.status = WITHDRAWN
            self.all.remove(work)
        self.version += 1

    def make(self, work: Work, form: str, choice: Print | Plan | None = None) -> Download:
        """Start making a file of a finished painting unless the file exists or is being made.

        A print or plan is made again if ``choice`` differs from the previous one.
        """
        download = work.downloads.get(form)
        is_other = download is not None and download.choice != choice and download.status != MAKING
        if download is None or is_other or download.status == BROKEN:
            download = work.downloads[form] = Download(form, choice, share=None if FORMS[form].draws is None else 0.0)
            self.version += 1
            maker = Thread(target=self._make, args=(work, download), name=f"making {form}", daemon=True)
            self._makers.append(maker)
            maker.start()
        return download

    def close(self) -> None:
        """Stop all work on paintings and files, and wait for the threads to end."""
        self._closing.set()
        for work in [work for work in self.all if work.is_open]:
            self.stop(work)
        if self._thread:
            self._thread.join()
        for maker in self._makers:
            maker.join()

    def _make(self, work: Work, download: Download) -> None:
        def tell(share: float | None) -> None:
            if self._closing.is_set():
                raise Stopped
            download.share = share
            self.version += 1

        try:
            with self._making:
                tell(download.share)
                download.path = make_file(work, download, tell)
            download.status = MADE
        except Exception as error:
            download.status = BROKEN
            download.trouble = str(error) if isinstance(error, UserError) else "it could not be made; try again"
            if not isinstance(error, (UserError, Stopped)):
                log.exception("making %s failed", download.form)
        self.version += 1

    def _warm(self) -> None:
        for look in ("oil", "plain"):  # together, these use the renderers of all looks
            if not self._closing.is_set():
                brushexp.paint("chelsea", look=look, resolution=48, steps=2, **self.options)
        self.is_warm.set()
        self.version += 1

    def _run(self, work: Work, before: Thread | None) -> None:
        if before:
            before.join()  # waits for the warm-up or the previous painting
        if work.stopped.is_set():
            return
        work.status = PAINTING
        self.version += 1
        try:
            with self.easel:  # waits for a draft to end
                self._paint(work)
            work.status = DONE
        except Exception as error:
            work.status = FAILED
            work.trouble = str(error) if isinstance(error, UserError) else f"this painting failed: {error}"
            if work.wishes.touch and work.wishes.touch.mask.name in work.trouble:  # a file unknown to the user
                work.trouble = TOO_SMALL
            log.log(logging.INFO if isinstance(error, UserError) else logging.ERROR, "%s", error, exc_info=True)
        self.version += 1

    def _paint(self, work: Work) -> None:
        self._glance(work)
        wishes, start = work.wishes, time.monotonic()
        options = wishes.overrides() | self.options
        if touch := wishes.touch:
            catalogue = touch.mask.with_name(f"{touch.mask.stem}_{work.number}.h5")
            lay_fresh_strokes(self[touch.number].painting, touch, work.number, catalogue)
            options = overrides_of(options, touch, catalogue)
        states = brushexp.iterate(wishes.subject.path, every=1, every_seconds=0.25, **options)
        planned = 0
        for state in states:
            planned = max(planned, state.steps)
            work.share, work.seconds_left = progress_of(state.step, planned, time.monotonic() - start, wishes.seconds)
            quality = f"{state.psnr:.1f} dB · {len(state.strokes):,} strokes · {time.monotonic() - start:.1f} s"
            work.add_frame(state.image, f"step {state.step} of {planned} · {quality}")
            self.version += 1
            if work.stopped.is_set() and state.painting is None:
                state.stop()
            if state.painting is not None:
                work.status = FINISHING
                self.version += 1
                if not self._closing.is_set():
                    state.painting.save(work.folder)
                    work.painting = state.painting

    def _glance(self, work: Work) -> None:
        """Show a preview of strokes predicted by a network until the painting's first picture is ready."""
        if (keys := work.wishes.at_a_glance()) is not None:
            painter: Any = brushexp.iterate(work.wishes.subject.path, **keys | self.options)
            with closing(painter) as states:
                first = next(states)
            caption = f"at a glance · {first.psnr:.1f} dB · {len(first.strokes):,} strokes"
            work.add_frame(first.image, caption, GLANCE)
            self.version += 1


def progress_of(step: int, steps: int, spent: float, limit: float | None) -> tuple[float, float | None]:
    """Return the finished fraction of a painting, and the remaining seconds, or None if they are not yet known.

    >>> progress_of(10, 40, 5.0, None), progress_of(10, 0, 5.0, 20.0), progress_of(0, 40, 0.1, None)
    ((0.25, 15.0), (0.25, 15.0), (0.0, None))
    """
    if limit is not None:
        return min(1.0, spent / limit), max(0.0, limit - spent)
    share = step / max(steps, 1)
    return share, (spent * (1 - share) / share if share else None)
