"""Define the elements of the page: plain HTML in the style of the run pages, and six scripted elements."""

from collections.abc import Callable
from functools import partial
from typing import Any

from nicegui import ui
from nicegui.elements.mixins.text_element import TextElement


class Tag(TextElement):
    """An HTML element: ``Tag("a", "button", "Save", href="/x")``."""

    def __init__(self, tag: str, classes: str = "", text: str = "", **attributes: Any) -> None:
        super().__init__(tag=tag, text=text)
        self.classes(classes)
        self.set(**attributes)

    def set(self, **attributes: Any) -> None:
        """Set attributes of the element; the value None removes an attribute."""
        for name, value in attributes.items():
            attribute = name.replace("_", "-")
            if value is None:
                self.props.pop(attribute, None)
            elif self.props.get(attribute) != value:
                self.props[attribute] = value


class Button(Tag):
    """A button that calls ``do`` when clicked; if it represents a choice, ``pressed`` tells whether it is chosen."""

    def __init__(
        self, text: str, do: Callable[[], Any], *, pressed: bool | None = None, classes: str = "button"
    ) -> None:
        super().__init__("button", classes, text, type="button")
        self.on("click", do)
        self.press(pressed)

    def press(self, pressed: bool | None) -> None:
        self.set(aria_pressed=None if pressed is None else str(pressed).lower())

    def allow(self, allowed: bool) -> None:
        self.set(disabled=None if allowed else True)


class Scripted(ui.element):
    """An element with a script and properties; ``answer`` receives the server's replies to its uploads."""

    def __init__(self, answer: Callable[[dict[str, Any]], Any] | None = None, **props: Any) -> None:
        super().__init__()
        self.props.update(props)
        if answer is not None:
            self.on("answer", lambda event: answer(event.args))


class Drop(Scripted, component="web/drop.js"):
    """A drop zone that uploads files to ``address``; ``whole`` makes it accept drops anywhere on the page."""


class Wipe(Scripted, component="web/wipe.js"):
    """Two pictures on either side of a divider; ``leftName`` and ``rightName`` describe ``left`` and ``right``."""


class Frames(Scripted, component="web/frames.js"):
    """A replay of pictures in sequence; ``frames`` lists their addresses, and ``captions`` their captions."""


class Blend(Scripted, component="web/blend.js"):
    """A slider that blends a photograph with its painting; ``saved`` is the address for saving the blend."""


class Mask(Scripted, component="web/mask.js"):
    """A mask painted over a ``picture`` of the given ``ratio`` (width / height).

    ``before`` is the address of an existing mask to start from; ``label`` and ``group`` describe the mask and its
    brush.
    """


class Slide(Scripted, component="web/slide.js"):
    """A labelled slider; ``change`` receives its value and returns the text shown next to the label."""

    def __init__(self, change: Callable[[float], str], **props: Any) -> None:
        super().__init__(shown=change(props["value"]), **props)
        self.on("change", lambda event: self.show(change(float(event.args))), throttle=0.1)

    def show(self, words: str) -> None:
        self.props["shown"] = words


def chips(name: str, choices: dict[Any, str], chosen: Any, choose: Callable[[Any], Any]) -> dict[Any, Button]:
    """Add a group of buttons, one of which is pressed, and return them by key; ``choose`` receives the clicked key."""
    buttons: dict[Any, Button] = {}

    def press(key: Any) -> Any:
        for other, button in buttons.items():
            button.press(other == key)
        return choose(key)

    with Tag("div", "chips", role="group", aria_label=name):
        for key, text in choices.items():
            buttons[key] = Button(text, partial(press, key), pressed=key == chosen, classes="choice")
    return buttons
