"""Take a screenshot of a page: ``python docs/site/page_shot.py outputs/x/report.html docs/images/report.jpg``."""

import io
import shutil
import sys
from pathlib import Path

from PIL import Image
from playwright.sync_api import sync_playwright

WIDE, SMALLER = {"width": 1320, "height": 1790}, 0.75


def main(report: Path, picture: Path) -> None:
    """Open the page in Chromium, and save its visible part as a JPEG."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        page = browser.new_page(viewport=WIDE, color_scheme="light")
        page.goto(report.resolve().as_uri())
        page.wait_for_timeout(3000)
        shot = Image.open(io.BytesIO(page.screenshot())).convert("RGB")
        size = (round(SMALLER * shot.width), round(SMALLER * shot.height))
        shot.resize(size, Image.Resampling.LANCZOS).save(picture, quality=82, optimize=True)
        browser.close()


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
