"""Build the right side of the page: photograph, painting, comparison, replay, files, and earlier paintings."""

from functools import partial
from pathlib import Path
from typing import Any

from nicegui import ui

from brushexp_studio.elements import Button, Drop, Frames, Mask, Tag, Wipe, chips
from brushexp_studio.visit import COMPARE, PAINTING, PHOTOGRAPH, REPLAY, VIEWS, Visit
from brushexp_studio.works import DONE, FAILED, GLANCE, PRINT_SIDE, WAITING, Work

FILES = {  # names on the page; a film is one of two kinds
    "painting.png": "PNG",
    "strokes.svg": "SVG",
    "catalogue.h5": "Strokes",
    "timelapse.mp4": "Film",
    "timelapse.gif": "Film",
    "report.html": "Page",
}
PRINTS = {"png": f"PNG, {PRINT_SIDE} pixels", "pdf": "PDF"}


class Easel:
    """The views of a visit."""

    def __init__(self, visit: Visit, receive: Any) -> None:
        self.visit, self.receive = visit, receive
        self.state: tuple[Any, ...] = ()
        with Tag("section", "easel", aria_label="The picture"):
            self.views = Tag("div", "chips", role="group", aria_label="What is shown")
            self.place = Tag("div", "place")
            self.caption = Tag("p", "caption hint")
            self.files = Tag("div", "files row")
            self.strip = Tag("div", "strip", role="group", aria_label="Paintings of this session")
        self.live: Tag | None = None
        visit.listeners.append(self.show)
        self.show()

    def show(self) -> None:
        """Show everything anew."""
        views = self.visit.views()
        if self.visit.view not in views:
            self.visit.view = views[-1] if views else PHOTOGRAPH
        self.views.clear()
        with self.views:
            for view in views:
                Button(VIEWS[view], partial(self._choose, view), pressed=view == self.visit.view, classes="choice")
        self.live = None
        self.place.clear()
        show = {PHOTOGRAPH: self._photograph, PAINTING: self._painting, COMPARE: self._compare, REPLAY: self._replay}
        with self.place:
            show[self.visit.view]()
        self._show_files()
        self._show_strip()
        self.renew()

    def renew(self) -> None:
        """Show the latest picture of the painting, and the rest anew if more than that has changed."""
        work, works = self.visit.work, self.visit.works
        state = (len(works.all), work and (work.number, work.status), bool(work and work.frames))
        if state != self.state:
            self.state = state
            self.show()
            return
        if work and work.frames and self.live:
            self.live.set(src=work.address)
        has_caption = work and work.frames and self.visit.view in (PAINTING, COMPARE)  # a replay has its own
        self.caption.set_text(work.frames[work.last][1] if work and has_caption else "")

    def _choose(self, view: str) -> None:
        self.visit.view = view
        self.visit.notify()

    def _photograph(self) -> None:
        photo, wishes = self.visit.wishes.photo, self.visit.wishes
        if photo is None:
            with Tag("div", "empty"):
                text = "Drop a photograph here, or choose one …"
                Drop(self.receive, name="Your photograph", text=text, address="/photos")
                Tag("p", "hint", text="It stays on this machine. Or take one of the samples.")
            return
        if wishes.focus == "mask":
            before, address = f"/masks/{wishes.mask.stem}.png" if wishes.mask else "", f"/photos/{photo.key}/masks"
            mask = Mask(self._take_mask, picture=photo.address, ratio=photo.ratio, address=address, before=before)
            mask.style(f"--ratio: {photo.ratio}")
        else:
            with Tag("div", "stage").style(f"--ratio: {photo.ratio}"):
                Tag("img", src=photo.address, alt=f"the photograph {photo.name}")

    def _take_mask(self, answer: dict[str, Any]) -> None:
        self.visit.wishes.mask = self.visit.photos.masks.get(str(answer.get("mask")))

    def _painting(self) -> None:
        work = self._work
        with Tag("div", "stage").style(f"--ratio: {work.ratio}"):
            if work.frames:
                self.live = Tag("img", src=work.address, alt=f"painting {work.title}")
            else:
                Tag("img", "bare", src=work.wishes.subject.address, alt="the photograph, to be painted")
        if work.frames:
            with Tag("div", "row tools"):
                Tag("button", "choice", "Look at it alone", type="button", data_zoom=".place .stage img")
        elif work.status == WAITING and self.visit.works.before(work):
            Tag("p", "caption hint", "It is painted when the ones before it are finished.")

    def _compare(self) -> None:
        work, other = self._work, self.visit.against
        left, name = (other.address, other.title) if other else (work.wishes.subject.address, "photograph")
        wipe = Wipe(left=left, leftName=name, right=work.address, rightName=work.title)
        wipe.style(f"--ratio: {work.ratio}")
        others = {each.number: each.title for each in self.visit.works.all if each is not work and each.frames}
        if others:
            with Tag("div", "row tools"):
                Tag("span", "hint", text="with")
                chips("Compare with", {0: "the photograph", **others}, other.number if other else 0, self._compare_with)

    def _compare_with(self, number: int) -> None:
        self.visit.against = self.visit.works[number] if number else None
        self.visit.notify()

    def _replay(self) -> None:
        work = self._work
        shown = {number: caption for number, (_, caption) in work.frames.items() if number != GLANCE}
        frames, captions = [f"/works/{work.number}/{number}.jpg" for number in shown], [*shown.values()]
        Frames(frames=frames, captions=captions).style(f"--ratio: {work.ratio}")

    def _show_files(self) -> None:
        self.files.clear()
        work = self.visit.work
        if work is None or work.status != DONE or self.visit.view == PHOTOGRAPH:
            return
        with self.files:
            Tag("span", "hint", text="Download")
            for name, title in FILES.items():
                if name in work.files:
                    target = "_blank" if Path(name).suffix == ".html" else None
                    Tag("a", "button", title, href=f"/works/{work.number}/files/{name}", target=target)
            for form, title in PRINTS.items():
                Tag("a", "button", title, href=f"/works/{work.number}/print.{form}", download="")
            Tag("a", "button", "Everything, zip", href=f"/works/{work.number}.zip")
            with Tag("p", "command-line"):
                Tag("code", text=work.wishes.command())
                Button("Copy", lambda: ui.clipboard.write(work.wishes.command()), classes="choice")

    def _show_strip(self) -> None:
        self.strip.clear()
        with self.strip:
            for work in reversed(self.visit.works.all):
                if work.frames or work.status == FAILED:
                    self._thumb(work)

    def _thumb(self, work: Work) -> None:
        pressed = work is self.visit.work
        with Button("", lambda: self.visit.look_at(work), pressed=pressed, classes="thumb"):
            if work.frames:
                Tag("img", src=work.address, alt=f"painting {work.title}")
            Tag("span", text=work.title)

    @property
    def _work(self) -> Work:
        assert self.visit.work is not None
        return self.visit.work
