"""What the page is made of: plain elements of HTML, in the style of the pages of runs, and five with scripts."""

from collections.abc import Callable
from functools import partial
from typing import Any

from nicegui import ui
from nicegui.elements.mixins.text_element import TextElement


class Tag(TextElement):
    """An element of HTML, ``Tag("a", "button", "Save", href="/x")``; in names a last ``_`` is left out."""

    def __init__(self, tag: str, classes: str = "", text: str = "", **attributes: Any) -> None:
        super().__init__(tag=tag, text=text)
        self.classes(classes)
        self.say(**attributes)

    def say(self, **attributes: Any) -> None:
        """Change attributes; None takes one away."""
        for name, value in attributes.items():
            attribute = name.rstrip("_").replace("_", "-")
            if value is None:
                self.props.pop(attribute, None)
            elif self.props.get(attribute) != value:
                self.props[attribute] = value


class Button(Tag):
    """A button that does something; one that is a choice says whether it is ``pressed``."""

    def __init__(
        self, text: str, do: Callable[[], Any], *, pressed: bool | None = None, classes: str = "button"
    ) -> None:
        super().__init__("button", classes, text, type="button")
        self.on("click", do)
        self.press(pressed)

    def press(self, pressed: bool | None) -> None:
        self.say(aria_pressed=None if pressed is None else str(pressed).lower())

    def allow(self, allowed: bool) -> None:
        self.say(disabled=None if allowed else True)


class Drop(ui.element, component="web/drop.js"):
    """A place for files; what the studio answers to one comes to ``answer``."""

    def __init__(self, name: str, text: str, address: str, answer: Callable[[dict[str, Any]], Any]) -> None:
        super().__init__()
        self.props.update(name=name, text=text, address=address)
        self.on("answer", lambda event: answer(event.args))


class Slide(ui.element, component="web/slide.js"):
    """A slider with a name; ``change`` gets the value, and returns the words that are shown beside the name."""

    def __init__(
        self, name: str, low: float, high: float, step: float, value: float, change: Callable[[float], str]
    ) -> None:
        super().__init__()
        self.props.update(name=name, low=low, high=high, step=step, value=value, shown=change(value))
        self.on("change", lambda event: self.show(change(float(event.args))), throttle=0.1)

    def show(self, words: str) -> None:
        self.props["shown"] = words


class Wipe(ui.element, component="web/wipe.js"):
    """Two pictures under a divider: addresses and names."""

    def __init__(self, left: tuple[str, str], right: tuple[str, str]) -> None:
        super().__init__()
        self.props.update(left=left[0], leftName=left[1], right=right[0], rightName=right[1])


class Frames(ui.element, component="web/frames.js"):
    """Pictures one after another: addresses, and what is said beside each."""

    def __init__(self, frames: list[str], captions: list[str]) -> None:
        super().__init__()
        self.props.update(frames=frames, captions=captions)


class Mask(ui.element, component="web/mask.js"):
    """A mask over a picture of a ratio (width / height); ``before`` is the address of one to go on with."""

    def __init__(
        self, picture: str, ratio: float, address: str, before: str, answer: Callable[[dict[str, Any]], Any]
    ) -> None:
        super().__init__()
        self.props.update(picture=picture, ratio=ratio, address=address, before=before)
        self.on("answer", lambda event: answer(event.args))


def chips(name: str, choices: dict[Any, str], chosen: Any, choose: Callable[[Any], Any]) -> None:
    """A group of buttons of which one is pressed; ``choose`` gets the key of the one that is."""
    buttons: dict[Any, Button] = {}

    def press(key: Any) -> Any:
        for other, button in buttons.items():
            button.press(other == key)
        return choose(key)

    with Tag("div", "chips", role="group", aria_label=name):
        for key, text in choices.items():
            buttons[key] = Button(text, partial(press, key), pressed=key == chosen, classes="choice")
