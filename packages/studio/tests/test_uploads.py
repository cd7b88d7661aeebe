"""Test that files other than pictures are refused in one line, and that paintings are queued and can be stopped."""

import asyncio
import errno
import io
import json
import re
import shlex
import socket
import sys
import time
import zipfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Event
from unittest.mock import Mock
from urllib.parse import quote

import numpy as np
import pytest
import skimage.data
from omegaconf import OmegaConf
from PIL import Image
from program import ask
from refusals import refuses

import brushexp
from brushexp.errors import UserError

pytest.importorskip("nicegui", reason="the studio is an extra")
from brushexp_studio import controls as studio_controls
from brushexp_studio import task as studio_task
from brushexp_studio.controls import Controls
from brushexp_studio.downloads import BROKEN, MADE, Download, make_file
from brushexp_studio.drafts import Drafts
from brushexp_studio.faces import find_faces, in_words, mask_of
from brushexp_studio.photos import PAINTINGS, SAMPLES, Photos
from brushexp_studio.plans import DIFFICULTIES, Plan
from brushexp_studio.prints import OWN, Print
from brushexp_studio.server import application, running
from brushexp_studio.tab import by_popularity
from brushexp_studio.visit import Visit
from brushexp_studio.wishes import Wishes
from brushexp_studio.works import DONE, Work, Works

pytestmark = pytest.mark.slow
CHELSEA = Path(skimage.data.__file__).parent / "chelsea.png"


@pytest.fixture
def uploads(tmp_path, caplog):
    """Run a studio server without its page in this process; finally check that no upload caused a traceback."""
    works = Works(tmp_path, {})
    with running(application(Photos(tmp_path), works, Drafts(works)), 0) as address:
        yield address
        status, body, _ = ask(address, "/photos", "POST", CHELSEA.read_bytes(), X_Name="after all.png")
        assert (status, b"photo" in body) == (200, True)
    assert not [record for record in caplog.records if record.exc_info]


def encoded_as(kind, picture=None):
    file = io.BytesIO()
    (picture or Image.radial_gradient("L")).save(file, kind)
    return file.getvalue()


def claiming(kind, place, size):
    """Encode a picture, and overwrite its header at byte ``place`` with a different size."""
    data = encoded_as(kind)
    return data[:place] + size + data[place + len(size) :]


WIDEST = b"\xff\xff\xff\xff"


def flipped(data, place):
    """Return a copy of ``data`` with one bit flipped in byte ``place``."""
    return data[:place] + bytes([data[place] ^ 1]) + data[place + 1 :]


SENT = {
    "nothing": (b"", "is empty"),
    "half a JPEG": (encoded_as("JPEG")[:900], "is damaged"),
    "half a PNG": (encoded_as("PNG")[:200], "is damaged"),
    "PNG with a flipped bit": (flipped(encoded_as("PNG"), 60), "do not match its checksums"),
    "GIF of 65535 x 65535": (claiming("GIF", 6, WIDEST), "megapixels"),
    "BMP of 2^31 x 2^31": (claiming("BMP", 18, b"\xff\xff\xff\x7f" * 2), "megapixels"),
    "a page": (b"<script>alert(1)</script>", "is not a picture"),
    "PostScript": (b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n", "is not supported"),
    "a pickle": (b"\x80\x04.", "is not a picture"),
    "more than 64 MB": (bytes(2**26 + 2**20), "make it smaller"),
}


def test_what_is_sent_is_a_picture_or_refused_in_one_line(uploads):
    for name, (data, message) in SENT.items():
        status, body, _ = ask(uploads, "/photos", "POST", data, X_Name=quote(name))
        assert status == 200, name
        said = json.loads(body)["error"]
        assert message in said, said
        assert "\n" not in said
    assert json.loads(ask(uploads, "/photos/nix/masks", "POST", encoded_as("PNG"))[1])["error"]
    many = encoded_as("GIF", Image.new("P", (900, 900)))
    assert json.loads(ask(uploads, "/photos", "POST", many * 9)[1]).keys() == {"photo"}


ODD_NAMES = ("..", "../../x.png", "/etc/passwd", "a\0\nb", "x" * 999, "🙂" * 99, "\u202egnp", "", "-rf", "${x}", "/")


@pytest.mark.parametrize("name", [*ODD_NAMES, "a." + "b" * 99])
def test_files_of_any_name_are_kept_below_the_folder_of_the_studio(tmp_path, name):
    Image.new("RGB", (9, 7)).save(tmp_path / "received", "PNG")
    kept = Photos(tmp_path).add(tmp_path / "received", name)
    assert kept.path.is_file()
    assert kept.path.parent == tmp_path / kept.key
    assert kept.name.isprintable()
    words = shlex.split(Wishes(photo=kept).command())
    assert words[:2] == ["brushexp", f"image={kept.name}"]


def test_who_leaves_in_the_middle_of_a_file_leaves_no_trace_and_a_full_disk_is_told(uploads, tmp_path, monkeypatch):
    for head in (b"Content-Length: 99999999999", b"Transfer-Encoding: chunked", b"Content-Length: -5"):
        with socket.create_connection(uploads.split("/")[2].split(":")) as connection:
            connection.sendall(b"POST /photos HTTP/1.1\r\nHost: localhost\r\n" + head + b"\r\n\r\nff\r\nabc")
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]
    full = OSError(errno.ENOSPC, "No space left on device")
    with monkeypatch.context() as patched:
        patched.setattr("brushexp_studio.server.NamedTemporaryFile", Mock(side_effect=full))
        answer = json.loads(ask(uploads, "/photos", "POST", b"x")[1])
    assert answer == {"error": "the studio cannot store this file: No space left on device"}


def test_pictures_that_come_at_once_are_decoded_one_after_another(tmp_path, monkeypatch):
    at_work, most, thumbnail = [], [], Image.Image.thumbnail

    def read(path, key):
        at_work.append(path)
        most.append(len(at_work))
        time.sleep(0.01)
        return np.zeros((7, 9, 3), np.uint8)

    monkeypatch.setattr("brushexp_studio.photos.read_picture", read)
    monkeypatch.setattr(Image.Image, "thumbnail", lambda *given: (thumbnail(*given), at_work.pop()))
    photos = Photos(tmp_path)
    with ThreadPoolExecutor(8) as threads:
        found = list(threads.map(lambda k: photos.add(tmp_path, f"{k}.png").name, range(8)))
    assert found == [f"{k}.png" for k in range(8)]
    assert max(most) == 1


def test_paintings_wait_for_their_turn_and_stop_is_for_those_of_ones_own_tab(tmp_path, monkeypatch):
    gate = Event()
    monkeypatch.setattr(Works, "_paint", lambda works, work: gate.wait(60))
    works = Works(tmp_path, {})
    mine, theirs = (Visit(Mock(), works, Mock(), [], Wishes(photo=Mock())) for _ in range(2))
    mine.arrive("first")
    mine.begun = works.begin(mine.wishes, mine)
    theirs.begun = works.begin(theirs.wishes, theirs)
    last = works.begin(theirs.wishes, theirs)
    theirs.work = mine.begun
    assert (theirs.stoppable(), mine.stoppable()) == (theirs.begun, mine.begun), "each tab can stop its own painting"
    assert works.before(last) == 2
    works.stop(theirs.begun)
    assert [work.number for work in works.all] == [1, 3], "a waiting painting is withdrawn"
    assert theirs.stoppable() is None, "the other tab is open"
    mine.is_there = False
    assert theirs.stoppable() is mine.begun, "the tab is gone"
    again = Visit(Mock(), works, Mock(), [])
    again.join()  # before the tab is identified
    again.arrive("first")
    assert again.stoppable() is again.work is mine.begun, "the tab was reloaded while other paintings wait"
    assert theirs.stoppable() is None
    gate.set()
    works._thread.join(60)
    assert {work.status for work in works.all} == {"done"}
    assert sorted(["plain", "oil", "own", "ink"], key=by_popularity) == ["oil", "ink", "plain", "own"]


def test_before_the_first_step_stands_what_a_network_lays_where_a_draft_begins_with_it(tmp_path, monkeypatch):
    photo = Mock(path="chelsea", size=(300, 451))
    oil = Wishes(photo=photo, seconds=9.0, side=64)
    assert oil.at_a_glance() == {"look": "oil", "resolution": 64, "frames": 60, "quality": "glance"}
    others = ({"look": "ink"}, {"quality": "draft"}, {"size": 2.0})
    assert [Wishes(photo=photo, **other).at_a_glance() for other in others] == [None] * 3
    larger = Wishes(photo=photo, quality="draft", size=2.0).overrides()
    assert (larger["init"], larger["init.length"]) == ("layers", 6.4), "sizes are those of the look's initialiser"
    more = Wishes(photo=photo, look="tubes", tubes="zorn", paper="laid", palette="muted").overrides()
    assert (more["tubes"], more["paper"], more["palette"]) == ("zorn", "laid", "muted")
    asked = []

    def iterate(_, **keys):
        asked.append(keys)
        yield Mock(
            image=np.zeros((4, 6, 3), np.uint8), psnr=20.0 + len(asked), strokes=[], step=0, steps=1, painting=None
        )

    monkeypatch.setattr("brushexp.iterate", iterate)
    work = Work(1, oil, tmp_path)
    Works(tmp_path, {})._paint(work)
    assert [keys.get("quality") for keys in asked] == ["glance", None]
    assert {number: caption[:20] for number, (_, caption) in work.frames.items()} == {
        -1: "at a glance · 21.0 d", 0: "step 0 of 1 · 22.0 d",
    }  # fmt: skip


def test_drafts_are_painted_while_nobody_paints(tmp_path, monkeypatch):
    works = Works(tmp_path, {})
    drafts, begun, go_on = Drafts(works), Event(), Event()

    def iterate(_, look, **keys):
        if look == "unknown":
            raise UserError("there is no such look")
        begun.set()
        go_on.wait(60)
        yield Mock(image=np.full((8, 9, 3), len(look), np.uint8))

    monkeypatch.setattr("brushexp.iterate", iterate)
    photo, looks = Mock(key="photo1", size=(80, 90)), ["unknown", "oil", "ink"]
    drafts.want(photo, looks)
    assert not begun.wait(0.5), "the kernels are not compiled yet"
    works.is_warm.set()
    assert begun.wait(60)
    works.all.append(work := Work(1, Wishes(photo=photo), tmp_path))
    go_on.set()
    with works.easel:
        assert drafts.address(photo, "oil") is None, "the Paint button ends a draft"
    works.all.remove(work)
    while len(drafts.pictures) < len(looks):
        time.sleep(0.01)
    drafts.close()
    assert [drafts.address(photo, look) for look in looks] == [
        None, "/drafts/photo1/oil.jpg", "/drafts/photo1/ink.jpg",
    ]  # fmt: skip
    assert drafts.address(None, "oil") is None


def made(works, work, form, paper=None):
    download = works.make(work, form, paper)
    for maker in works._makers:
        maker.join(60)
    return download


def test_a_file_is_made_once_and_tells_how_far_it_is(tmp_path):
    painting = brushexp.paint("coffee", look="oil", resolution=64, steps=2)
    works = Works(tmp_path, {})
    work = Work(1, Wishes(photo=Mock(path=tmp_path / "photo.png")), tmp_path / "1", status=DONE)
    work.wishes.photo.configure_mock(name="coffee.png", ratio=1.5)
    painting.save(work.folder)
    work.painting = painting
    for form, layers in (("png", None), ("ora", 11)):
        shares = []
        paper = Print(OWN, side=2.0, bleed=3.0) if form == "png" else None
        path = make_file(work, Download(form, paper), shares.append)
        assert shares == sorted(shares)
        assert shares[-1] == 1
        assert len(shares) >= (layers or 1)
        if form == "png":
            with Image.open(path) as large:
                assert max(large.size) == 236 + 2 * 35, "2 cm at 300 dpi, and 3 mm on each side"
    zipped = made(works, work, "zip")
    assert (zipped.status, zipped.share) == (MADE, 1)
    assert works.make(work, "zip") is zipped
    with zipfile.ZipFile(zipped.path) as archive:
        names = {Path(name).name for name in archive.namelist()}
    assert "painting.png" in names
    assert "painting.ora" not in names, "files made on request are not the painting's own files"
    work.downloads["pdf"] = Download("pdf", Print("A5"), MADE)
    assert works.make(work, "pdf", Print("A5")).status == MADE
    work.painting = None
    lost = made(works, work, "pdf", Print("A4"))
    assert (lost.status, lost.trouble) == (BROKEN, "this painting was not kept; paint it again")
    assert works.make(work, "pdf", Print("A4")) is not lost, "the file is tried again"


def test_a_plan_is_made_for_each_difficulty(tmp_path):
    painting = brushexp.paint("coffee", look="tubes", resolution=64, steps=2)
    works, work = Works(tmp_path, {}), Work(1, Wishes(photo=Mock(ratio=1.5)), tmp_path / "1", status=DONE)
    work.wishes.photo.name, work.painting = "coffee.png", painting
    sizes = {}
    for difficulty in DIFFICULTIES:
        download = made(works, work, "plan", Plan(difficulty))
        assert (download.status, download.trouble) == (MADE, "")
        sizes[difficulty] = len((download.path.parent / "plan.csv").read_text())
    assert sizes["easy"] < sizes["hard"] <= sizes[""]
    assert works.make(work, "plan", Plan(difficulty)) is download


def test_a_blend_is_the_photograph_the_painting_or_between(tmp_path):
    work = Work(1, Wishes(photo=Mock(path=tmp_path / "photo.png")), tmp_path, status=DONE)
    for name, grey in (("photo", 40), ("painting", 240)):
        Image.new("RGB", (9, 6), (grey,) * 3).save(tmp_path / f"{name}.png")
    assert [int(grey_of(work.blend(percent))) for percent in (0, 25, 100, 999)] == [40, 90, 240, 240]


def grey_of(picture):
    return np.asarray(Image.open(io.BytesIO(picture)))[0, 0, 0]


def test_what_a_file_says_of_its_damage_is_told(tmp_path):
    (tmp_path / "received").write_bytes(encoded_as("BMP", Image.new("RGB", (60, 40))))
    photo = Photos(tmp_path).add(tmp_path / "received", "black.bmp")
    assert (
        photo.remark == "black.bmp has one colour throughout; if it should have more, the file is damaged; get it again"
    )


@pytest.mark.parametrize("keep", ["/proc/x", __file__])
def test_a_folder_that_cannot_keep_paintings_is_refused_before_there_are_any(tmp_path, keep):
    words = f"cannot write into keep={re.escape(keep)}: .*; choose another folder"
    refuses(words, studio_task.run, OmegaConf.create({"keep": keep}), tmp_path, 0.0)


def test_without_the_extra_it_says_what_to_install(tmp_path, monkeypatch):
    for module in ("nicegui", "brushexp_studio.server"):
        monkeypatch.setitem(sys.modules, module, None)
    refuses(r"pip install 'brushexp\[studio\]'", studio_task.run, OmegaConf.create(), tmp_path, 0.0)


def test_of_two_plans_that_of_the_later_choice_is_shown_whichever_comes_first(monkeypatch):
    gate, controls = asyncio.Event(), Mock(visit=Mock(wishes=Wishes(photo=Mock(), look="oil")))

    async def slow_for_oil(compute):
        if (plan := compute())[0] == len("oil"):
            await gate.wait()
        return plan

    async def choose():
        oil = asyncio.create_task(Controls._renew_strokes(controls))
        await asyncio.sleep(0)
        controls.visit.wishes.look = "plain"
        await Controls._renew_strokes(controls)
        gate.set()
        await oil

    monkeypatch.setattr(studio_controls, "planned_strokes", lambda wishes: len(wishes.look))
    monkeypatch.setattr(studio_controls, "own_size", lambda look: {})
    monkeypatch.setattr(studio_controls.run, "io_bound", slow_for_oil)
    with ThreadPoolExecutor() as pool:  # other tests' browser uses this thread's event loop
        pool.submit(asyncio.run, choose()).result()
    controls.number.show.assert_called_once_with("set by the look: 5")


def test_faces_are_counted_and_marked(tmp_path):
    photos = Photos(tmp_path)
    photo = photos["astronaut"]
    assert [in_words(len(find_faces(photos[key]))) for key in ("astronaut", "coffee")] == [
        "Found 1 face.", "Found no face.",
    ]  # fmt: skip
    mask = mask_of(find_faces(photo), photo.size)
    assert mask.shape == photo.size
    assert mask[110, 225] == 255, "the mask covers her nose"
    assert 0.01 < (mask > 0).mean() < 0.1
    kept = photos.masks[photos.keep_mask(mask)]
    assert kept.is_file()
    wishes = Wishes(photo=photo, look="gouache", focus="mask", mask=kept)
    assert wishes.overrides()["focus"] == wishes.overrides()["faces"] == str(kept)
    assert "focus=mask.png faces=mask.png" in wishes.command()
    assert "faces" not in Wishes(photo=photo, focus="mask").overrides()


def test_samples_are_there_and_the_command_of_a_style_names_a_file(tmp_path):
    photos = Photos(tmp_path)
    for key in (*SAMPLES, *PAINTINGS):
        assert min(photos[key].size) >= 256
    style = photos["coffee_in_gouache"]
    command = Wishes(photo=photos["coffee"], style=style).command()
    assert f"style.image={PAINTINGS['coffee_in_gouache']}" in shlex.split(command)
    assert PAINTINGS["coffee_in_gouache"].is_file()
