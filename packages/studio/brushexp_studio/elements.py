"""Define the elements of the page: plain HTML in the style of run pages, and six elements with scripts."""

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
        """Change attributes; None removes an attribute."""
        for name, value in attributes.items():
            attribute = name.replace("_", "-")
            if value is None:
                self.props.pop(attribute, None)
            elif self.props.get(attribute) != value:
                self.props[attribute] = value


class Button(Tag):
    """A button that calls ``do``; ``pressed`` is its state if it is a choice."""

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
    """An element with a script and properties; ``answer`` receives the replies to its uploads."""

    def __init__(self, answer: Callable[[dict[str, Any]], Any] | None = None, **props: Any) -> None:
        super().__init__()
        self.props.update(props)
        if answer is not None:
            self.on("answer", lambda event: answer(event.args))


class Drop(Scripted, component="web/drop.js"):
    """A drop zone for files with ``name``, ``text`` and upload ``address``; ``whole`` covers the page."""


class Wipe(Scripted, component="web/wipe.js"):
    """Two pictures on either side of a divider: addresses ``left`` and ``right``, ``leftName`` and ``rightName``."""


class Frames(Scripted, component="web/frames.js"):
    """Pictures one after another: addresses ``frames``, and ``captions``."""


class Blend(Scripted, component="web/blend.js"):
    """A slider from a photograph to its painting: addresses ``photograph``, ``painting`` and ``saved`` (the blend)."""


class Mask(Scripted, component="web/mask.js"):
    """A mask over a ``picture`` with a ``ratio`` (width / height); ``before`` is the address of a mask to continue.

    ``label`` and ``group`` describe the mask and its brush.
    """


class Slide(Scripted, component="web/slide.js"):
    """A slider with a name; ``change`` receives the value and returns the text next to the name."""

    def __init__(self, change: Callable[[float], str], **props: Any) -> None:
        super().__init__(shown=change(props["value"]), **props)
        self.on("change", lambda event: self.show(change(float(event.args))), throttle=0.1)

    def show(self, words: str) -> None:
        self.props["shown"] = words


def chips(name: str, choices: dict[Any, str], chosen: Any, choose: Callable[[Any], Any]) -> dict[Any, Button]:
    """Add a group of buttons, one of them pressed, and return the buttons by key; ``choose`` receives a key."""
    buttons: dict[Any, Button] = {}

    def press(key: Any) -> Any:
        for other, button in buttons.items():
            button.press(other == key)
        return choose(key)

    with Tag("div", "chips", role="group", aria_label=name):
        for key, text in choices.items():
            buttons[key] = Button(text, partial(press, key), pressed=key == chosen, classes="choice")
    return buttons
