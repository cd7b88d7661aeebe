"""Hold the state of one browser tab; all tabs share the same paintings."""

from collections.abc import Callable
from dataclasses import dataclass, field

from brushexp_studio.drafts import Drafts
from brushexp_studio.photos import Photo, Photos
from brushexp_studio.plans import Plan
from brushexp_studio.prints import Print
from brushexp_studio.wishes import Wishes
from brushexp_studio.works import DONE, Work, Works

PHOTOGRAPH, PAINTING, COMPARE, BLEND, TOUCH, REPLAY = "photograph", "painting", "compare", "blend", "touch", "replay"
VIEWS = {
    PHOTOGRAPH: "Photograph",
    PAINTING: "Painting",
    COMPARE: "Compare",
    BLEND: "Blend",
    TOUCH: "Touch up",
    REPLAY: "Replay",
}


@dataclass
class Visit:
    """The choices, painting and view of one tab; ``listeners`` are called after each change."""

    photos: Photos
    works: Works
    drafts: Drafts
    looks: list[str]
    wishes: Wishes = field(default_factory=Wishes)
    view: str = PHOTOGRAPH
    work: Work | None = None  # painting on the easel
    against: Work | None = None  # painting to compare with; None means the photograph
    begun: Work | None = None  # last painting started by this tab
    is_there: bool = True  # whether the tab is open
    tab: str | None = None  # the browser's identifier, which survives a reload
    paper: Print = field(default_factory=Print)  # size of prints
    plan: Plan = field(default_factory=Plan)
    reading: int = 0  # number of chosen pictures that are still being read
    wanted: set[tuple[int, str]] = field(default_factory=set)  # files (painting, form) to save once they are made
    listeners: list[Callable[[], None]] = field(default_factory=list)

    def notify(self) -> None:
        """Tell all parts of the page that the state has changed."""
        for listener in self.listeners:
            listener()

    def take_photo(self, photo: Photo) -> None:
        """Choose the picture to paint, and discard the mask of the previous one."""
        self.wishes.photo, self.wishes.mask, self.view = photo, None, PHOTOGRAPH
        self.notify()

    def stoppable(self) -> Work | None:
        """Return the painting that Stop ends: this tab's own, or the displayed one if that painting's tab is closed."""
        shown = self.work if self.work and not getattr(self.work.owner, "is_there", False) else None
        return next((work for work in (self.begun, shown) if work and work.is_open), None)

    def look_at(self, work: Work) -> None:
        """Show a painting on the easel."""
        self.work, self.view = work, PAINTING
        if self.against is work:
            self.against = None
        self.notify()

    def arrive(self, tab: str | None) -> None:
        """Connect this visit to a browser tab; after a reload, show the latest painting that the tab began."""
        self.is_there, self.tab = True, tab
        mine = [work for work in self.works.all if tab is not None and getattr(work.owner, "tab", None) == tab]
        for work in mine:
            work.owner = self
        if mine and self.begun is None:
            self.begun = mine[-1]
            self.wishes.photo = mine[-1].wishes.photo
            self.look_at(mine[-1])

    def join(self) -> None:
        """Show the latest painting, even if another tab began it, unless this tab already shows one."""
        if self.work is None and self.works.all:
            self.wishes.photo = self.wishes.photo or self.works.all[-1].wishes.photo
            self.look_at(self.works.all[-1])

    def views(self) -> list[str]:
        """List the views that are currently available."""
        views = [PHOTOGRAPH] if self.wishes.photo else []
        if self.work:
            views += [PAINTING]
            views += [COMPARE] if self.work.frames else []
            views += [BLEND] if "painting.png" in self.work.files else []
            views += [TOUCH] if self.work.painting is not None and self.work.status == DONE else []
            views += [REPLAY] if len(self.work.frames) > 1 and not self.work.is_open else []
        return views
