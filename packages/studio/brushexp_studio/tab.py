"""Build the studio's page for each tab: a bar, controls, an easel, and buttons that start and stop a painting."""

import asyncio
from pathlib import Path

from fastapi import FastAPI
from nicegui import ui

from brushexp.contracts import UserError
from brushexp.contracts.pages import TEMPLATES
from brushexp.contracts.tasks import look_names
from brushexp_studio.controls import Controls
from brushexp_studio.drafts import Drafts
from brushexp_studio.easel import Easel
from brushexp_studio.elements import Button, Tag
from brushexp_studio.photos import Photos
from brushexp_studio.visit import Visit
from brushexp_studio.wishes import Wishes
from brushexp_studio.works import FAILED, FINISHING, WAITING, Works

MOMENT = 0.2  # seconds between two updates
LONGEST_GAP = 30.0  # seconds for which a tab keeps its choices without a connection, as on a busy machine
LIKELY = ("oil", "watercolour", "impasto", "vangogh", "pastel", "ink", "gouache", "pointillist", "plain")
WEB = Path(__file__).parent / "web"
ICON = (
    "<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 32 32'>"
    "<path d='M5 23Q14 3 27 9' fill='none' stroke='#3a5fc8' stroke-width='8' stroke-linecap='round'/></svg>"
)


def add_page(app: FastAPI, photos: Photos, works: Works, drafts: Drafts) -> None:
    """Add the studio's page to an application, at the address ``/``."""
    head = "".join(f"<script>{(TEMPLATES / name).read_text()}</script>" for name in ("theme.js", "zoom.js"))
    head += "".join(f"<style>{path.read_text()}</style>" for path in (TEMPLATES / "page.css", WEB / "studio.css"))
    bar = (WEB / "bar.html").read_text()

    @ui.page("/")
    def studio() -> None:
        ui.add_head_html(head)
        ui.html(bar, sanitize=False)
        Tab(Visit(photos, works, drafts, sorted(look_names(), key=by_popularity)))

    ui.run_with(
        app, title="brushexp studio", favicon=ICON, dark=None, language="en-US", tailwind=False,
        show_welcome_message=False, reconnect_timeout=LONGEST_GAP,
    )  # fmt: skip


def by_popularity(look: str) -> tuple[int, str]:
    """Return a sort key that puts popular looks first, and the user's own looks last in alphabetical order."""
    return (LIKELY.index(look) if look in LIKELY else len(LIKELY)), look


class Tab:
    """The part of a browser tab below the page's header."""

    controls: Controls

    def __init__(self, visit: Visit) -> None:
        self.visit, self.works = visit, visit.works
        self.version = -1
        visit.join()
        client = ui.context.client
        client.on_connect(lambda: visit.arrive(client.tab_id))
        client.on_disconnect(lambda: setattr(visit, "is_there", False))
        with Tag("div", "studio"):
            Tag("h1", "unseen", "brushexp studio")
            self.easel = Easel(visit, lambda answer: self.controls.receive(answer, visit.take_photo), self.begin)
            self.controls = Controls(visit, self.complain)
            with Tag("div", "doing"):
                self.main = Button("Paint", self.paint, classes="button main")
                self.stop = Button("Stop", self.end)
                self.bar = Tag("progress", aria_label="Progress of the painting", max=1)
                self.status = Tag("p", "status hint", role="status")
                self.trouble = Tag("p", "alarm", role="alert")
        visit.listeners.append(self.renew)
        ui.timer(MOMENT, self.look)
        self.renew()

    def complain(self, words: str) -> None:
        self.trouble.set_text(words)

    async def paint(self) -> None:
        """Paint the chosen picture with the current choices, after waiting for pictures that are still being read."""
        while self.visit.reading:  # otherwise it would paint the previous picture
            await asyncio.sleep(MOMENT)
        self.begin(self.visit.wishes)

    def begin(self, wishes: Wishes) -> None:
        """Start a painting and show it; repeated clicks are ignored until its first picture appears."""
        last = self.visit.begun
        if last and last.is_open and not last.frames and last.wishes == wishes:
            return
        try:
            work = self.visit.begun = self.works.begin(wishes, self.visit)
        except UserError as error:
            self.complain(str(error))
            return
        self.complain("")
        self.visit.look_at(work)
        ui.run_javascript("scrollTo({ top: 0 })")

    def end(self) -> None:
        """Stop the painting that this tab can stop (see `Visit.stoppable`); the result so far is kept."""
        if work := self.visit.stoppable():
            self.works.stop(work)
            if work not in self.works.all:
                self.visit.work = None
            self.look()
            self.renew()

    def look(self) -> None:
        """Update the page if anything has changed since the last call."""
        if self.version != self.works.version:
            self.version = self.works.version
            self.visit.join()
            self.easel.renew()
            self.controls.show_drafts()
            self.renew()

    def renew(self) -> None:
        """Update the buttons, the progress bar and the status line."""
        work, mine = self.visit.work, self.visit.stoppable()
        self.main.allow(self.visit.wishes.photo is not None)
        self.stop.allow(mine is not None and mine.status != FINISHING and not mine.stopped.is_set())
        self.stop.set_text("Withdraw" if mine and self.works.before(mine) else "Stop")
        current = self.works.current
        self.bar.set_visibility(bool(current and current.frames))
        self.bar.set(value=f"{current.share:.3f}" if current else 0)
        self.status.set_text(self.describe())
        if work and work.status == FAILED:
            self.complain(work.trouble)

    def describe(self) -> str:
        """Return the text of the status line, which says what the studio is currently doing."""
        current = self.works.current
        if current is None:
            return "" if self.visit.wishes.photo else "Choose a picture first."
        if current.status == FINISHING:
            return "Writing the files …"
        if current.stopped.is_set():
            return "Stopping after this step …"
        if current.frames:
            left = current.seconds_left
            words = f"Painting {current.title}" + ("" if left is None else f", {in_words(left)} left")
        else:
            words = "Laying the first strokes …" if self.works.is_warm.is_set() else "Warming up …"
        mine = self.visit.begun
        waits = self.works.before(mine) if mine and mine.status == WAITING else 0
        return words + (f"; yours is next after {waits}" if waits else "")


def in_words(seconds: float) -> str:
    """Format a remaining time.

    >>> in_words(7.4), in_words(200)
    ('7 s', '3 min')
    """
    return f"{seconds:.0f} s" if seconds < 90 else f"{seconds / 60:.0f} min"
