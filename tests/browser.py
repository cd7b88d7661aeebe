"""Headless Chromium for page tests, which records the errors and requests of each page.

The fixtures ``browser`` and ``opened`` are available in every test. To wait for a page, use selectors: the content
security policy of our pages blocks the scripts that ``wait_for_function`` evaluates repeatedly.
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
    """A page, the script errors and console messages it produced, and the addresses it requested."""

    page: Any
    errors: list[str] = field(default_factory=list)
    requests: list[str] = field(default_factory=list)

    @property
    def foreign(self) -> list[str]:
        """Return the requested addresses that are neither local files nor data embedded in the page."""
        return [address for address in self.requests if not address.startswith(("file:", "data:", "blob:"))]

    def evaluate(self, script: str, argument: object = None) -> Any:
        """Evaluate a JavaScript expression or function in the page."""
        return self.page.evaluate(script, argument)

    def is_too_wide(self) -> bool:
        """Return whether the page scrolls sideways."""
        return self.evaluate("document.documentElement.scrollWidth > document.documentElement.clientWidth")


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    """Start the installed Chromium or else Playwright's own, and skip the test if neither exists."""
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
    """Return ``opened(path, size=WIDE)``, which opens a page without animations (``prefers-reduced-motion``)."""
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
