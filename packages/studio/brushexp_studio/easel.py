"""Build the right side of the page: photograph, painting, comparison, replay, files and earlier paintings."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from nicegui import background_tasks, run, ui

from brushexp_studio.downloads import BROKEN, FORMS, MADE, MAKING, Form, describe_file, possible_forms
from brushexp_studio.elements import Blend, Button, Drop, Frames, Mask, Tag, Wipe, chips
from brushexp_studio.faces import find_faces, in_words, mask_of
from brushexp_studio.photos import Photo
from brushexp_studio.plans import DIFFICULTIES, Plan
from brushexp_studio.print_controls import PrintControls
from brushexp_studio.prints import Print
from brushexp_studio.touches import TOUCH_KINDS, Touch
from brushexp_studio.visit import BLEND, COMPARE, PAINTING, PHOTOGRAPH, REPLAY, TOUCH, VIEWS, Visit
from brushexp_studio.wishes import Wishes
from brushexp_studio.works import DONE, FAILED, GLANCE, WAITING, Work

FILES = {  # names on the page; a film is either an MP4 or a GIF
    "painting.png": "PNG",
    "strokes.svg": "SVG",
    "catalogue.h5": "Strokes",
    "timelapse.mp4": "Film",
    "timelapse.gif": "Film",
    "report.html": "Page",
}


class Easel:
    """The right side of the page, which shows the chosen view of the picture, its files, and earlier paintings."""

    def __init__(self, visit: Visit, receive: Any, begin: Callable[[Wishes], None]) -> None:
        self.visit, self.receive, self.begin = visit, receive, begin
        self.touched: Path | None = None  # mask of the place to repaint
        self.state: tuple[Any, ...] = ()
        self.made: tuple[tuple[str, str], ...] = ()  # forms of files and their progress
        with Tag("section", "easel", aria_label="The picture"):
            self.views = Tag("div", "chips", role="group", aria_label="View")
            self.place = Tag("div", "place")
            self.caption = Tag("p", "caption hint")
            self.files = Tag("section", "files", aria_label="Download")
            self.prints = PrintControls(visit, self._show_files)
            self.strip = Tag("div", "strip", role="group", aria_label="Paintings of this session")
        self.live: Tag | None = None
        self.making: dict[str, tuple[Tag, Tag]] = {}  # texts and progress bars of files being made, by form
        visit.listeners.append(self.show)
        self.show()

    def show(self) -> None:
        """Redraw all parts of the easel."""
        views = self.visit.views()
        if self.visit.view not in views:
            self.visit.view = views[-1] if views else PHOTOGRAPH
        self.views.clear()
        with self.views:
            for view in views:
                Button(VIEWS[view], partial(self._choose, view), pressed=view == self.visit.view, classes="choice")
        self.live = None
        self.place.clear()
        show = {PHOTOGRAPH: self._photograph, PAINTING: self._painting, COMPARE: self._compare, BLEND: self._blend}
        show |= {TOUCH: self._touch, REPLAY: self._replay}
        with self.place:
            show[self.visit.view]()
        self._show_files()
        self._show_strip()
        self.renew()

    def renew(self) -> None:
        """Show the latest picture of the painting; redraw the whole easel if anything else has changed."""
        work, works = self.visit.work, self.visit.works
        made = tuple((key, download.status) for key, download in work.downloads.items()) if work else ()
        state = (len(works.all), work and (work.number, work.status), bool(work and work.frames))
        if made != self.made:
            self.made = made
            self._show_files()
        if state != self.state:
            self.state = state
            self.show()
            return
        self._renew_files()
        if work and work.frames and self.live:
            self.live.set(src=work.address)
        has_caption = work and work.frames and self.visit.view in (PAINTING, COMPARE)  # a replay has its own caption
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
                Tag("p", "hint", text="It stays on this machine. Or choose one of the samples.")
            return
        if wishes.focus == "mask":
            before, address = f"/masks/{wishes.mask.stem}.png" if wishes.mask else "", f"/photos/{photo.key}/masks"
            label = "Where the painting should be most faithful to the photograph"
            words = {"label": label, "group": "Brush of the focus"}
            mask = Mask(
                self._take_mask, picture=photo.address, ratio=photo.ratio, address=address, before=before, **words
            )
            mask.style(f"--ratio: {photo.ratio}")
            hint = "Click on each face, or paint over the parts that should be most faithful to the photograph."
            Tag("p", "caption hint", hint)
        else:
            with Tag("div", "stage").style(f"--ratio: {photo.ratio}"):
                Tag("img", src=photo.address, alt=f"the photograph {photo.name}")
            with Tag("div", "row tools"):
                found = Tag("span", "hint", "Looking for faces …", role="status")
                Button("Mark a face", partial(self._mark_faces, photo), classes="choice")
            background_tasks.create(self._count_faces(photo, found))

    async def _count_faces(self, photo: Photo, found: Tag) -> None:
        faces = await run.io_bound(find_faces, photo)
        if faces is not None and not found.is_deleted:
            found.set_text(in_words(len(faces)))

    async def _mark_faces(self, photo: Photo) -> None:
        """Let the visitor mark faces by hand, starting from a mask of the detected faces."""
        faces = await run.io_bound(find_faces, photo)
        wishes = self.visit.wishes
        if wishes.mask is None and faces:
            wishes.mask = self.visit.photos.masks.get(str(self.visit.photos.keep_mask(mask_of(faces, photo.size))))
        wishes.focus = "mask"
        self.visit.notify()

    def _take_mask(self, answer: dict[str, Any]) -> None:
        self.visit.wishes.mask = self.visit.photos.masks.get(str(answer.get("mask")))

    def _painting(self) -> None:
        work = self._work
        with Tag("div", "stage").style(f"--ratio: {work.ratio}"):
            if work.frames:
                self.live = Tag("img", src=work.address, alt=f"painting {work.title}")
            else:
                Tag("img", "bare", src=work.wishes.subject.address, alt="the photograph to paint")
        if work.frames:
            with Tag("div", "row tools"):
                Tag("button", "choice", "Show it alone", type="button", data_zoom=".place .stage img")
        elif work.status == WAITING and self.visit.works.before(work):
            Tag("p", "caption hint", "It will be painted after the paintings before it.")

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

    def _blend(self) -> None:
        work = self._work
        photograph, saved = work.wishes.subject.address, f"/works/{work.number}/blend/"
        Blend(photograph=photograph, painting=work.address, saved=saved).style(f"--ratio: {work.ratio}")

    def _touch(self) -> None:
        work, self.touched = self._work, None
        buttons: list[Button] = []

        def take(answer: dict[str, Any]) -> None:
            self.touched = self.visit.photos.masks.get(str(answer.get("mask")))
            for button in buttons:
                button.allow(self.touched is not None)

        words = {"label": "The place to repaint", "group": "Brush of the place"}
        address = f"/photos/{work.wishes.subject.key}/masks"
        mask = Mask(take, picture=work.address, ratio=work.ratio, address=address, before="", **words)
        mask.style(f"--ratio: {work.ratio}")
        Tag("p", "caption hint", "Paint over a place to repaint it; everything else stays as it is.")
        with Tag("div", "row tools", role="group", aria_label="Touch up"):
            for how, title in TOUCH_KINDS.items():
                buttons.append(Button(title, partial(self._begin_touch, work, how)))
                buttons[-1].allow(False)

    def _begin_touch(self, work: Work, how: str) -> None:
        if self.touched is not None:
            self.begin(replace(work.wishes, touch=Touch(work.number, self.touched, how)))

    def _replay(self) -> None:
        work = self._work
        shown = {number: caption for number, (_, caption) in work.frames.items() if number != GLANCE}
        frames, captions = [f"/works/{work.number}/{number}.jpg" for number in shown], [*shown.values()]
        Frames(frames=frames, captions=captions).style(f"--ratio: {work.ratio}")

    def _show_files(self) -> None:
        self.files.clear()
        self.prints.files.clear()
        self.making = {}
        work = self.visit.work
        has_files = work is not None and work.status == DONE and self.visit.view != PHOTOGRAPH
        self.prints.show(work if has_files else None)
        if work is None or not has_files:
            return
        forms = possible_forms(work)
        with self.files:
            Tag("h2", text="Download")
            with Tag("ul", "downloads"):
                for name, title in FILES.items():
                    if name in work.files:
                        self._show_file(name, title, work)
                for key, form in forms.items():
                    if not form.is_print:
                        self._show_form(key, form, work)
            if work.wishes.touch is None:
                with Tag("p", "command-line"):
                    Tag("code", text=work.wishes.command())
                    Button("Copy", lambda: ui.clipboard.write(work.wishes.command()), classes="choice")
        with self.prints.files:
            for key, form in forms.items():
                if form.is_print:
                    self._show_form(key, form, work)

    def _show_file(self, name: str, title: str, work: Work) -> None:
        target = "_blank" if Path(name).suffix == ".html" else None
        with Tag("li"):
            Tag("a", "button", title, href=f"/works/{work.number}/files/{name}", target=target)
            Tag("small", text=describe_file(work.files[name], work.wishes.canvas))

    def _show_form(self, key: str, form: Form, work: Work) -> None:
        """Add a file that is made on request: a button, then its progress, then a link."""
        download = work.downloads.get(key)
        if download and download.status != MAKING and download.choice != self._choice_for(key):
            download = None  # made for another size or difficulty
        with Tag("li"):
            if download and download.status == MADE:
                Tag("a", "button", form.title, href=f"/works/{work.number}/made/{key}", download="")
            else:
                button = Button(form.title, partial(self._make, key, work))
                button.allow(download is None or download.status == BROKEN)
            if download and download.status == MAKING:
                with Tag("span", "making"):
                    words = Tag("small", text=download.words, role="status")
                    self.making[key] = words, Tag("progress", aria_label=f"Progress of {form.title}", max=1)
            else:
                Tag("small", text=download.trouble if download and download.trouble else form.what)
            if key == "plan":
                chips("Difficulty of the plan", DIFFICULTIES, self.visit.plan.difficulty, self._take_difficulty)

    def _choice_for(self, key: str) -> Print | Plan | None:
        """Return the visitor's choice of print size or plan difficulty, or None for files that offer no choice."""
        if FORMS[key].is_print:
            return self.visit.paper
        return self.visit.plan if key == "plan" else None

    def _take_difficulty(self, difficulty: str) -> None:
        self.visit.plan = Plan(difficulty)
        if "plan" in self._work.downloads:  # its link may lead to a plan of another difficulty
            self._show_files()

    def _make(self, key: str, work: Work) -> None:
        self.visit.wanted.add((work.number, key))
        self.visit.works.make(work, key, self._choice_for(key))
        self.renew()

    def _renew_files(self) -> None:
        """Update the progress of files that are being made, and download the finished files that this tab requested."""
        work, works = self.visit.work, self.visit.works
        for key, (words, bar) in self.making.items():
            if work and (download := work.downloads.get(key)):
                words.set_text(download.words)
                bar.set(value=None if download.share is None else f"{download.share:.3f}")
        for number, key in [*self.visit.wanted]:
            download = works[number].downloads[key]
            if download.status != MAKING:
                self.visit.wanted.discard((number, key))
            if download.status == MADE:
                ui.download.from_url(f"/works/{number}/made/{key}")

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
