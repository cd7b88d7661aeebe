"""A real browser for the tests of pages: headless Chromium, the errors in a page, and what it asked for.

The fixtures ``browser`` and ``opened`` are known to every test. Wait for what a page does with selectors: what
Playwright evaluates again and again (``wait_for_function``) is refused by the policy of our pages.
"""

import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

ARGUMENTS = ["--no-sandbox", "--disable-gpu", "--disable-background-networking", "--force-color-profile=srgb"]
WIDE, NARROW = (1440, 900), (375, 740)


@dataclass
class Watched:
    """A page, the errors of its console, and the addresses that it asked for."""

    page: Any
    errors: list[str] = field(default_factory=list)
    requests: list[str] = field(default_factory=list)

    @property
    def foreign(self) -> list[str]:
        """What was asked for beyond files and pictures in the page itself."""
        return [address for address in self.requests if not address.startswith(("file:", "data:", "blob:"))]

    def evaluate(self, script: str, argument: object = None) -> Any:
        """The value of a JavaScript expression or function in the page."""
        return self.page.evaluate(script, argument)

    def is_too_wide(self) -> bool:
        """Whether the page can be scrolled sideways."""
        return self.evaluate("document.documentElement.scrollWidth > document.documentElement.clientWidth")


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    """Chromium from the machine, or else Playwright's own; the test is skipped where there is neither."""
    sync_api = pytest.importorskip("playwright.sync_api", reason="pages are tested with playwright")
    with sync_api.sync_playwright() as playwright:
        path = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
        try:
            chromium = playwright.chromium.launch(executable_path=path, args=ARGUMENTS)
        except sync_api.Error as error:
            pytest.skip(f"no Chromium: install chromium, or run `playwright install chromium` ({error})")
        yield chromium
        chromium.close()


@pytest.fixture(scope="module")
def opened(browser: Any) -> Iterator[Callable[..., Watched]]:
    """Open a page: ``opened(path, size=WIDE)``; nothing in it moves by itself (``prefers-reduced-motion``)."""
    contexts = []

    def open_page(path: Path, size: tuple[int, int] = WIDE, **options: Any) -> Watched:
        viewport = {"width": size[0], "height": size[1]}
        context = browser.new_context(viewport=viewport, reduced_motion="reduce", **options)
        context.set_default_timeout(10_000)
        contexts.append(context)
        watched = Watched(context.new_page())
        watched.page.on("pageerror", lambda error: watched.errors.append(str(error)))
        watched.page.on("console", lambda message: watched.errors.append(message.text))
        watched.page.on("request", lambda request: watched.requests.append(request.url))
        watched.page.goto(path.resolve().as_uri())
        return watched

    yield open_page
    for context in contexts:
        context.close()
