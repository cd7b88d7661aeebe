"""Build the left side of the page: picture, look, strokes, time, canvas, focus, style, paper, palette and tubes."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from typing import Any

from nicegui import background_tasks, run, ui

from brushexp.contracts import UserError
from brushexp_studio.elements import Button, Drop, Slide, Tag, chips
from brushexp_studio.photos import PAINTINGS, SAMPLES, Photo
from brushexp_studio.visit import PHOTOGRAPH, Visit
from brushexp_studio.wishes import (
    AS_LOOK,
    FOCUS,
    PALETTES,
    PAPERS,
    QUALITIES,
    SIDES,
    TUBES,
    TUBES_LOOK,
    Wishes,
    own_size,
    planned_strokes,
)

SECONDS = "seconds"  # alternative to the qualities
NONE = ""  # key for no picture
FEWEST_STROKES, MOST_STROKES, NOTCHES = 50, 10_000, 80  # range of the slider for strokes, and its positions


class Controls:
    """Input controls for a visitor's choices; ``complain`` shows an error message on the page."""

    def __init__(self, visit: Visit, complain: Callable[[str], None]) -> None:
        self.visit, self.complain = visit, complain
        self.displayed: dict[str, Photo | None] = {}
        self.asked: Wishes | None = None  # choices for which the shown number of strokes was planned
        self.samples: dict[str, Tag] = {}  # pictures of looks
        self.thumbs: dict[str, dict[str, Button]] = {}  # thumbnails of pictures and of styles, by key
        with Tag("section", "controls", aria_label="What to paint and how"):
            with part("Picture"):
                self.pictures = Tag("div", "thumbs", role="group", aria_label="Picture")
            with part("Look"), Tag("div", "looks", role="group", aria_label="Look"):
                self.looks = {look: self._look(look) for look in visit.looks}
            with part("Strokes"):
                self.number = Slide(self._take_number, name="How many", low=0, high=NOTCHES, step=1, value=0)
                self.size = Slide(self._take_size, name="How large", low=-1, high=1, step=0.05, value=0)
            with part("Time", "best takes minutes"):
                times = {name: name.capitalize() for name in (*QUALITIES, SECONDS)}
                chips("Time", times, visit.wishes.quality, self._take_time)
                seconds = {"name": "Seconds of painting", "low": 1, "high": 120, "step": 1, "value": 10}
                self.seconds = Slide(self._take_seconds, **seconds)
                self.seconds.set_visibility(False)
            with part("Canvas", "pixels on the longer side"):
                chips("Canvas", {side: str(side) for side in SIDES}, visit.wishes.side, self._take_side)
            with part("Focus", "where the painting is most faithful to the photograph"):
                self.focus = chips("Focus", FOCUS, visit.wishes.focus, self._take_focus)
            with part("In the style of", "colours and marks of another picture"):
                self.styles = Tag("div", "thumbs", role="group", aria_label="Style")
            with Tag("details", "part more"):
                Tag("summary", text="More: paper, palette, tubes")
                with part("Paper", "the surface below the paint"):
                    chips("Paper", PAPERS, visit.wishes.paper, self._take_paper)
                with part("Palette", "the range of colours"):
                    chips("Palette", PALETTES, visit.wishes.palette, self._take_palette)
                with part("Tubes", "mixed from real paints, with a plan for painting by hand"):
                    self.tubes = chips("Tubes", TUBES, visit.wishes.tubes, self._take_tubes)
        visit.listeners.append(self.show)
        self.show()

    def show(self) -> None:
        """Show the available pictures, and mark the chosen ones."""
        wishes = self.visit.wishes
        for focus, button in self.focus.items():
            button.press(focus == wishes.focus)
        for place, chosen, name, take in (
            (self.pictures, wishes.photo, "picture", self.visit.take_photo),
            (self.styles, wishes.style, "style", self._take_style),
        ):
            if self.displayed.get(name, ()) is chosen:
                continue
            self.displayed[name] = chosen
            if name == "picture" and chosen:
                self.visit.drafts.want(chosen, self.visit.looks)
                self.show_drafts()
                background_tasks.create(self._renew_strokes())
            key = chosen.key if chosen else NONE
            # Existing thumbnails stay, because a click on a removed one would be lost.
            if key not in self.thumbs.get(name, ()):
                place.clear()
                with place:
                    self.thumbs[name] = self._thumbs(name, chosen, take)
            for other, button in self.thumbs[name].items():
                button.press(other == key)

    def show_drafts(self) -> None:
        """Show, for each look, the finished draft of the photograph or, until there is one, a sample of the look."""
        for look, sample in self.samples.items():
            address = self.visit.drafts.address(self.visit.wishes.photo, look)
            sample.set(src=address or f"/looks/{look}.webp")

    def _thumbs(self, name: str, chosen: Photo | None, take: Callable[[Photo], None]) -> dict[str, Button]:
        """Add thumbnails of the sample pictures or styles, and one of the visitor's own picture; return them by key."""
        none = Button("None", lambda: self._take_style(None), classes="drop") if name == "style" else None
        whole = name == "picture"  # accepts a file dropped anywhere on the page
        own = {"name": f"Your own {name}", "text": "Your own", "address": "/photos", "whole": whole}
        Drop(partial(self.receive, take=take), **own)
        shipped = SAMPLES if name == "picture" else tuple(PAINTINGS)
        names = {chosen.key: chosen.name} if chosen and chosen.key not in shipped else {}
        names |= {key: key.replace("_", " ") for key in shipped}
        thumbs = {key: self._thumb(key, title, take) for key, title in names.items()}
        return thumbs if none is None else {NONE: none, **thumbs}

    def _thumb(self, key: str, title: str, take: Callable[[Photo], None]) -> Button:
        async def choose() -> None:
            self.visit.reading += 1
            try:
                photo = await run.io_bound(lambda: self.visit.photos[key])  # the first access reads the file
                if photo is not None:  # None if the studio is closing
                    take(photo)
            finally:
                self.visit.reading -= 1

        button = Button("", choose, classes="thumb")
        with button:
            Tag("img", src=f"/photos/{key}/thumb.jpg", alt=title, title=title)
        return button

    def _look(self, look: str) -> Button:
        async def choose() -> None:
            if look != TUBES_LOOK:
                self.visit.wishes.tubes = AS_LOOK
            await self._take_look(look)

        button = Button("", choose, pressed=look == self.visit.wishes.look, classes="look-choice")
        with button:
            self.samples[look] = Tag("img", src=f"/looks/{look}.webp", alt="")
            Tag("span", text=look)
        return button

    async def _take_look(self, look: str) -> None:
        self.visit.wishes.look = look
        for name, button in self.looks.items():
            button.press(name == look)
        for tubes, button in self.tubes.items():
            button.press(tubes == self.visit.wishes.tubes)
        await self._renew_strokes()

    def _take_paper(self, paper: str) -> None:
        self.visit.wishes.paper = paper

    def _take_palette(self, palette: str) -> None:
        self.visit.wishes.palette = palette

    async def _take_tubes(self, tubes: str) -> None:
        """Choose a set of paints.

        Choosing a set also selects the look that uses real paints; choosing none replaces this look with the first one.
        """
        wishes = self.visit.wishes
        wishes.tubes = tubes
        if tubes:
            await self._take_look(TUBES_LOOK)
        elif wishes.look == TUBES_LOOK:
            await self._take_look(self.visit.looks[0])

    def receive(self, answer: dict[str, Any], take: Callable[[Photo], None]) -> None:
        """Use an uploaded picture, or show the error that it caused."""
        self.complain(str(answer.get("error", "")))
        if "photo" in answer:
            try:
                photo = self.visit.photos[str(answer["photo"])]
                take(photo)
                self.complain(photo.remark)
            except UserError as error:
                self.complain(str(error))

    def _take_style(self, photo: Photo | None) -> None:
        self.visit.wishes.style = photo
        self.show()

    def _take_number(self, notch: float) -> str:
        share = (notch - 1) / (NOTCHES - 1)
        strokes = None if notch == 0 else round(FEWEST_STROKES * (MOST_STROKES / FEWEST_STROKES) ** share)
        self.visit.wishes.strokes = strokes and int(float(f"{strokes:.2g}"))
        return "set by the look" if strokes is None else f"{self.visit.wishes.strokes:,}"

    def _take_size(self, power: float) -> str:
        self.visit.wishes.size = round(2**power, 2)
        return "set by the look" if power == 0 else f"{self.visit.wishes.size:g} ×"

    async def _take_time(self, name: str) -> None:
        timed = name == SECONDS
        self.visit.wishes.seconds = self.seconds_chosen if timed else None
        self.visit.wishes.quality = "normal" if timed else name
        self.seconds.set_visibility(timed)
        await self._renew_strokes()

    def _take_seconds(self, value: float) -> str:
        self.seconds_chosen = value
        if self.visit.wishes.seconds is not None:
            self.visit.wishes.seconds = value
        return f"{value:g} s"

    async def _take_side(self, side: int) -> None:
        self.visit.wishes.side = side
        await self._renew_strokes()

    def _take_focus(self, focus: str) -> None:
        self.visit.wishes.focus = focus
        if focus == "mask":
            self.visit.view = PHOTOGRAPH
            ui.run_javascript("scrollTo({ top: 0 })")
        self.visit.notify()

    async def _renew_strokes(self) -> None:
        """Show the planned number of strokes, and show the size slider only if the look has its own stroke size."""
        wishes = self.visit.wishes
        if wishes.photo is None:
            return
        self.asked = asked = replace(wishes)
        plan = await run.io_bound(lambda: (planned_strokes(asked), own_size(asked.look)))
        if asked is not self.asked:  # superseded by a later choice, whose plan may already be shown
            return
        if plan and wishes.strokes is None:
            self.number.show(f"set by the look: {plan[0]:,}")
        self.size.set_visibility(bool(plan and plan[1]))


@contextmanager
def part(title: str, hint: str = "") -> Iterator[None]:
    """Add a section with a heading to the controls within the ``with`` block."""
    with Tag("section", "part"):
        with Tag("h2", text=title):
            if hint:
                Tag("small", text=hint)
        yield
