"""Take the screenshots in docs/studio.md from a running studio.

python docs/site/studio_shots.py http://127.0.0.1:8080/
"""

import io
import shutil
import sys
from pathlib import Path

from PIL import Image
from playwright.sync_api import Page, sync_playwright

IMAGES = Path(__file__).parents[1] / "images"
WIDE, PHONE = {"width": 1280, "height": 920}, {"width": 390, "height": 844}
MARK = [(0.2, 0.32), (0.3, 0.36), (0.24, 0.42)]  # over an eye of the cat, in shares of its sides


def choose(page: Page, group: str, name: str) -> None:
    """Click a button in a group."""
    page.get_by_role("group", name=group, exact=True).get_by_role("button", name=name, exact=True).click()


def paint(page: Page, number: int, look: str) -> None:
    """Start a painting, and wait for its first picture."""
    choose(page, "Look", look)
    page.get_by_role("button", name="Paint", exact=True).click()
    page.locator(f".place .stage img[src^='/works/{number}/']").wait_for(timeout=300_000)
    page.wait_for_timeout(1500)


def finish(page: Page, number: int) -> None:
    """Wait until the files of a painting are ready."""
    page.locator(f"a[href='/works/{number}/files/painting.png']").wait_for(timeout=300_000)


def shot(page: Page) -> Image.Image:
    """Take a screenshot of the visible part of the page."""
    page.wait_for_timeout(500)
    return Image.open(io.BytesIO(page.screenshot()))


def save(name: str, *pictures: Image.Image) -> None:
    """Save pictures side by side as one JPEG."""
    sheet = Image.new(
        "RGB", (sum(one.width for one in pictures) + 24 * (len(pictures) - 1), pictures[0].height), "white"
    )
    for k, one in enumerate(pictures):
        sheet.paste(one, (k * (one.width + 24), 0))
    sheet.save(IMAGES / name, quality=82, optimize=True)


def main(address: str) -> None:
    """Capture two looks on a wide page, then comparison, retouching and printing on a phone."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        page = browser.new_page(viewport=WIDE, color_scheme="light")
        page.goto(address)
        choose(page, "Picture", "chelsea")
        page.locator(".look-choice:last-child img[src^='/drafts/']").wait_for(timeout=600_000)
        paint(page, 1, "watercolour")
        finish(page, 1)
        paint(page, 2, "oil")
        save("studio.jpg", shot(page))
        finish(page, 2)
        phone = browser.new_page(viewport=PHONE, color_scheme="dark", has_touch=True)
        phone.goto(address)
        choose(phone, "View", "Compare")
        choose(phone, "Compare with", "1 · watercolour")
        compared = shot(phone)
        choose(phone, "View", "Touch up")
        phone.wait_for_timeout(1000)
        box = phone.locator("canvas").bounding_box() or {}
        places = [(box["x"] + x * box["width"], box["y"] + y * box["height"]) for x, y in MARK]
        phone.mouse.move(*places[0])
        phone.mouse.down()
        for place in places:
            phone.mouse.move(*place, steps=5)
        phone.mouse.up()
        phone.mouse.move(0, 0)
        phone.evaluate("scrollTo(0, 0)")
        marked = shot(phone)
        choose(phone, "View", "Painting")
        phone.get_by_role("slider", name="Bleed, to be trimmed").press("End")
        phone.get_by_text("10 mm of bleed on each side").wait_for()  # the buttons are new, too
        phone.get_by_role("button", name="PNG to print").scroll_into_view_if_needed()
        phone.evaluate("scrollBy(0, 90)")  # above the bar of buttons
        save("studio_phone.jpg", compared, marked, shot(phone))
        browser.close()


if __name__ == "__main__":
    main(sys.argv[1])
