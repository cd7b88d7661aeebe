"""What one tab of the browser shows and has chosen; the paintings belong to all tabs."""

from collections.abc import Callable
from dataclasses import dataclass, field

from brushexp_studio.photos import Photo, Photos
from brushexp_studio.wishes import Wishes
from brushexp_studio.works import Work, Works

PHOTOGRAPH, PAINTING, COMPARE, REPLAY = "photograph", "painting", "compare", "replay"
VIEWS = {PHOTOGRAPH: "Photograph", PAINTING: "Painting", COMPARE: "Compare", REPLAY: "Replay"}


@dataclass
class Visit:
    """A tab: its choices, the painting that it looks at, and how; parts of the page listen to changes."""

    photos: Photos
    works: Works
    looks: list[str]
    wishes: Wishes = field(default_factory=Wishes)
    view: str = PHOTOGRAPH
    work: Work | None = None  # that is shown
    against: Work | None = None  # that it is compared with; None is its photograph
    listeners: list[Callable[[], None]] = field(default_factory=list)

    def changed(self) -> None:
        """Tell all parts of the page."""
        for listener in self.listeners:
            listener()

    def take_photo(self, photo: Photo) -> None:
        """Choose what is to be painted; a mask was for the picture before."""
        self.wishes.photo, self.wishes.mask, self.view = photo, None, PHOTOGRAPH
        self.changed()

    def look_at(self, work: Work, view: str = PAINTING) -> None:
        """Show a painting."""
        self.work, self.view = work, view
        if self.against is work:
            self.against = None
        self.changed()

    def join(self) -> None:
        """Show what another tab has painted last, if this one has chosen nothing yet."""
        if self.work is None and self.works.all:
            self.wishes.photo = self.wishes.photo or self.works.all[-1].wishes.photo
            self.look_at(self.works.all[-1])

    def views(self) -> list[str]:
        """Ways to look that there are now."""
        views = [PHOTOGRAPH] if self.wishes.photo else []
        if self.work:
            views += [PAINTING]
            views += [COMPARE] if self.work.frames else []
            views += [REPLAY] if len(self.work.frames) > 1 and self.works.current is not self.work else []
        return views
