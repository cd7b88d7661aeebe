"""Test ``task=studio`` in a real browser with a real photograph; all tests share one server."""

import io
import re
import signal
import time
import zipfile
from pathlib import Path
from urllib.parse import urlsplit

import pytest
import skimage.data
from PIL import Image
from program import Program, ask

pytest.importorskip("nicegui", reason="the studio is an extra")

pytestmark = pytest.mark.slow
WIDE, PHONE = (1280, 860), (390, 844)
CHELSEA = Path(skimage.data.__file__).parent / "chelsea.png"


@pytest.fixture(scope="module")
def studio(tmp_path_factory):
    """Start a studio, yield its address, and finally close it with Ctrl-C."""
    folder = tmp_path_factory.mktemp("studio")
    process = Program("task=studio", "open=false", "threads=1", f"output={folder}/out", cwd=folder, TMPDIR=str(folder))
    log, found = folder / "out" / "run.log", None
    while not found and process.poll() is None:
        time.sleep(0.05)
        found = re.search(r"http://\S+", log.read_text()) if log.is_file() else None
    assert found, process.communicate()
    yield found[0]
    process.send_signal(signal.SIGINT)
    out, err = process.communicate()
    assert process.returncode == 0, err
    assert "the studio is closed" in out
    assert "Traceback" not in out + err
    assert not list(folder.glob("brushexp-studio-*")), "uploads are deleted"


@pytest.fixture
def tab(studio, browser):
    """Yield a function that opens the studio in a new tab; finally check for errors and requests to other machines."""
    contexts, asked, errors = [], [], []

    def open_tab(size=WIDE, **options):
        viewport = {"width": size[0], "height": size[1]}
        context = browser.new_context(viewport=viewport, reduced_motion="reduce", **options)
        contexts.append(context)
        context.set_default_timeout(60_000)
        context.route("**/*", lambda route: (asked.append(route.request.url), route.continue_()))
        page = context.new_page()
        page.on("websocket", lambda socket: asked.append(socket.url))
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.on("console", lambda said: errors.append(said.text) if said.type == "error" else None)
        page.goto(studio)
        page.get_by_role("button", name="Paint", exact=True).wait_for()
        return page

    yield open_tab
    for context in contexts:
        context.close()
    here = urlsplit(studio).netloc
    assert {urlsplit(url).netloc for url in asked if not url.startswith(("data:", "blob:"))} == {here}
    assert not errors


def choose(page, group, name):
    page.get_by_role("group", name=group, exact=True).get_by_role("button", name=name, exact=True).click()


def paint(page, number, look):
    """Paint a small picture in a few steps, and wait for the files."""
    choose(page, "Canvas", "256")
    choose(page, "Time", "Draft")
    choose(page, "Look", look)
    page.get_by_role("button", name="Paint", exact=True).click()
    finish(page, number)


def finish(page, number):
    page.locator(f"a[href='/works/{number}/files/painting.png']").wait_for(timeout=120_000)


def fits(page):
    """Check that the page does not scroll sideways, that all controls have names, and that none of them overlap."""
    assert page.evaluate("document.documentElement.scrollWidth <= document.documentElement.clientWidth")
    nameless = """[...document.querySelectorAll("button, a, input, canvas")].filter((one) => one.checkVisibility() &&
      !(one.ariaLabel || one.labels?.length || one.innerText?.trim() || one.querySelector("img[alt]:not([alt=''])")))
      .map((one) => one.outerHTML)"""
    assert page.evaluate(nameless) == []
    over = """[...document.querySelectorAll("button, a")].filter((one) => {
      if (!one.checkVisibility() || one.closest(".doing, .bar")) return false;
      one.scrollIntoView({ block: "center" });
      const box = one.getBoundingClientRect();
      const there = document.elementFromPoint(box.x + box.width / 2, box.y + box.height / 2);
      return !one.contains(there);
    }).map((one) => one.outerHTML)"""
    assert page.evaluate(over) == []


def test_a_visitor_uploads_a_photograph_paints_it_and_takes_everything_home(tab, tmp_path):
    page = tab(accept_downloads=True)
    assert page.get_by_role("button", name="Paint", exact=True).is_disabled()
    (tmp_path / "notes.jpg").write_text("no picture at all")
    page.get_by_label("Your own picture").set_input_files(tmp_path / "notes.jpg")
    alert = page.get_by_role("alert")
    alert.get_by_text("notes.jpg is not a picture of a known format").wait_for()
    assert str(tmp_path) not in alert.inner_text()
    page.evaluate(
        """([name, bytes]) => {
          const files = new DataTransfer();
          files.items.add(new File([Uint8Array.from(bytes)], name));
          document.querySelector("h2").dispatchEvent(
            new DragEvent("drop", { bubbles: true, cancelable: true, dataTransfer: files }));
        }""",
        ["写真 cat.png", list(CHELSEA.read_bytes())],
    )  # dropped outside every field
    page.get_by_alt_text("the photograph 写真 cat").wait_for()
    page.get_by_text(re.compile(r"set by the look: [\d,]+")).wait_for()
    choose(page, "Look", "plain")  # 1,500 steps, so that it is stopped before it ends
    choose(page, "Canvas", "512")
    choose(page, "Time", "Best")
    page.get_by_role("button", name="Paint", exact=True).click()
    picture = page.locator(".place .stage img[src^='/works/']")
    picture.wait_for()
    first = picture.get_attribute("src")
    another = page.locator(f".place .stage img[src^='/works/']:not([src='{first}'])")
    another.wait_for(timeout=180_000)  # updates automatically; kernels may be compiled first
    assert re.match(r"step \d+ of \d+ · \d+\.\d dB · [\d,]+ strokes", page.locator(".caption").inner_text())
    page.get_by_role("button", name="Stop").dispatch_event("click")  # the page moves during painting
    finish(page, 1)
    done, steps = re.match(r"step (\d+) of (\d+)", page.locator(".caption").inner_text()).groups()
    assert int(done) < int(steps), "the stopped painting is kept"
    with page.expect_download() as download:
        page.get_by_role("button", name="Everything, zip").click()
    page.get_by_role("link", name="Everything, zip").wait_for()  # for saving it again
    assert download.value.suggested_filename == "写真_cat-plain-1.zip"
    with zipfile.ZipFile(download.value.path()) as archive:
        names = {Path(name).name for name in archive.namelist()}
    assert names >= {"painting.png", "strokes.svg", "catalogue.h5", "report.html", "target.png", "metrics.json"}
    with page.expect_download() as download:
        page.get_by_role("link", name="PNG", exact=True).click()
    with Image.open(download.value.path()) as painting:
        assert painting.size == (451, 300)
    assert download.value.suggested_filename == "写真_cat-plain-1-painting.png"
    with page.context.expect_page() as report:
        page.get_by_role("link", name="Page", exact=True).click()
    report.value.get_by_role("heading", name="Replay").wait_for()  # wait until the new tab has loaded


def test_a_large_file_says_how_far_it_is_before_it_is_saved(tab):
    page = tab(PHONE, accept_downloads=True)
    choose(page, "Picture", "coffee")
    paint(page, 2, "oil")
    page.get_by_text(re.compile(r"^vector file; [\d.]+\s[Mk]B, of bitmaps for the bristles$")).wait_for()
    choose(page, "Paper size", "A5")
    bleed = page.get_by_role("slider", name="Bleed, to be trimmed")
    bleed.press("End")
    page.get_by_text("21 × 14 cm and 10 mm of bleed on each side, at 300 dpi").wait_for()
    with page.expect_download(timeout=120_000) as download:
        page.get_by_role("button", name="PDF to print").click()
        page.get_by_text(re.compile(r"^Making the PDF … \d+ %$")).wait_for(timeout=1000)
        assert page.get_by_role("button", name="PDF to print").is_disabled()
    assert re.search(r"-oil-2-A5\.pdf$", download.value.suggested_filename)
    assert b"/TrimBox [28.3200 28.3200 " in Path(download.value.path()).read_bytes()
    choose(page, "View", "Blend")
    share = page.get_by_role("slider", name="From photograph to painting")
    share.press("Home")
    assert share.get_attribute("aria-valuetext") == "0 % painting"
    share.press("ArrowRight")
    with page.expect_download() as download:
        page.get_by_role("link", name="Download as seen").click()
    assert download.value.suggested_filename.endswith("-oil-2-1.png")
    fits(page)


def test_two_paintings_are_compared_and_replayed(tab):
    page = tab(PHONE, color_scheme="dark", has_touch=True)
    choose(page, "Picture", "chelsea")
    paint(page, 3, "gouache")
    paint(page, 4, "ink")
    choose(page, "View", "Compare")
    choose(page, "Compare with", "3 · gouache")
    divider = page.get_by_role("slider", name="Divider between 3 · gouache and 4 · ink")
    divider.focus()
    page.keyboard.press("Home")
    assert divider.get_attribute("aria-valuetext") == "0 % from the left"
    choose(page, "View", "Replay")
    page.get_by_role("button", name="Play").wait_for()  # the replay has ended
    moment = page.get_by_role("slider", name="Moment of the painting")
    moment.press("Home")
    assert "step 0 of" in moment.get_attribute("aria-valuetext")
    fits(page)
    other = tab()  # shows the same paintings
    other.get_by_role("button", name="painting 4 · ink").wait_for()
    fits(other)


def test_a_plan_is_as_difficult_as_the_visitor_chooses(tab):
    page = tab(PHONE, accept_downloads=True)
    choose(page, "Picture", "coffee")
    page.get_by_text("More: paper, palette, tubes").click()
    choose(page, "Tubes", "Primaries")
    paint(page, 5, "tubes")
    choose(page, "Difficulty of the plan", "Easy")
    with page.expect_download(timeout=120_000) as download:
        page.get_by_role("button", name="Plan", exact=True).click()
    assert download.value.suggested_filename.endswith("-tubes-5-plan-easy.pdf")
    page.get_by_role("link", name="Plan", exact=True).wait_for()
    choose(page, "Difficulty of the plan", "As painted")
    page.get_by_role("button", name="Plan", exact=True).wait_for()  # the easy plan is no longer offered
    fits(page)


def test_the_focus_is_painted_by_touch_and_by_keyboard(tab, studio):
    page = tab(PHONE, has_touch=True)
    choose(page, "Picture", "astronaut")
    page.get_by_text("Found 1 face.").wait_for()
    choose(page, "Focus", "Painted by hand")
    canvas = page.get_by_role("img", name=re.compile("arrow keys move the brush"))
    painted = """(canvas) => {
      const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
      return data.filter((value, k) => k % 4 === 3 && value > 0).length / (canvas.width * canvas.height);
    }"""
    with page.expect_response("**/masks") as answer:
        canvas.tap()
    dab = canvas.evaluate(painted)
    assert dab == pytest.approx(3.14159 * 0.09**2, rel=0.1)
    canvas.press("ArrowLeft")
    canvas.press("ArrowLeft")
    with page.expect_response("**/masks") as answer:
        canvas.press(" ")
    assert dab < canvas.evaluate(painted) < 2.2 * dab
    status, png, _ = ask(studio, f"/masks/{answer.value.json()['mask']}.png")
    mask = Image.open(io.BytesIO(png)).convert("L").resize((64, 64))
    assert status == 200
    assert mask.getpixel((32, 32)) == 255
    assert mask.getpixel((32, 5)) == 0
    fits(page)
    page.get_by_role("button", name="Eraser").click()
    canvas.tap()
    assert canvas.evaluate(painted) < 1.5 * dab
    page.get_by_role("button", name="Clear").click()
    assert canvas.evaluate(painted) == 0
    choose(page, "Focus", "Set by the look")
    page.get_by_role("button", name="Mark a face").click()
    canvas.wait_for()
    assert page.get_by_role("button", name="Painted by hand").get_attribute("aria-pressed") == "true"


def test_only_pages_of_the_studio_on_this_machine_are_answered(studio):
    port = urlsplit(studio).port
    assert ask(studio, "/", Host=f"localhost:{port}")[0] == 200
    assert ask(studio, "/", Host="evil.example")[0] == 400  # a name that may resolve to this machine
    assert ask(studio, "/photos", "POST", b"x", Origin="http://evil.example")[0] == 403
    assert ask(studio, "/photos", "POST", b"x", Origin="null")[0] == 403
    socket = {"Upgrade": "websocket", "Connection": "Upgrade", "Sec_WebSocket_Version": "13"}
    socket |= {"Sec_WebSocket_Key": "x3JJHMbDL1EzLkh9GBhXDw=="}
    path = "/_nicegui_ws/socket.io/?EIO=4&transport=websocket"
    assert ask(studio, path, Origin="http://evil.example", **socket)[0] == 403
    missing = ("/works/99.zip", "/photos/none/thumb.jpg", "/masks/..%2Fx.png", "/docs")
    for path in (*missing, "/works/1/files/../../run.log"):
        assert ask(studio, path)[0] == 404, path
