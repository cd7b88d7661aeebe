"""What a visitor of the studio sends is a picture, or is refused in a line, and lies below the folder of the studio."""

import errno
import io
import json
import shlex
import socket
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from unittest.mock import Mock
from urllib.parse import quote

import numpy as np
import pytest
import skimage.data
from PIL import Image
from program import ask

pytest.importorskip("nicegui", reason="the studio is an extra")
from brushexp_studio.photos import Photos
from brushexp_studio.server import application, running
from brushexp_studio.wishes import Wishes
from brushexp_studio.works import Works

pytestmark = pytest.mark.slow
CHELSEA = Path(skimage.data.__file__).parent / "chelsea.png"


@pytest.fixture
def uploads(tmp_path, caplog):
    """Address of a studio without the page, in this process; nothing that is sent brings a traceback."""
    with running(application(Photos(tmp_path), Works(tmp_path, {})), 0) as address:
        yield address
        status, body, _ = ask(address, "/photos", "POST", CHELSEA.read_bytes(), X_Name="after all.png")
        assert (status, b"photo" in body) == (200, True)
    assert not [record for record in caplog.records if record.exc_info]


def encoded_as(kind, picture=None):
    file = io.BytesIO()
    (picture or Image.radial_gradient("L")).save(file, kind)
    return file.getvalue()


def claiming(kind, place, size):
    """A picture whose header says that its sides are others; those lie at ``place``."""
    data = encoded_as(kind)
    return data[:place] + size + data[place + len(size) :]


WIDEST = b"\xff\xff\xff\xff"
SENT = {
    "nothing": (b"", "is empty"),
    "half a JPEG": (encoded_as("JPEG")[:900], "is damaged"),
    "half a PNG": (encoded_as("PNG")[:200], "is damaged"),
    "GIF of 65535 x 65535": (claiming("GIF", 6, WIDEST), "megapixels"),
    "BMP of 2^31 x 2^31": (claiming("BMP", 18, b"\xff\xff\xff\x7f" * 2), "megapixels"),
    "a page": (b"<script>alert(1)</script>", "is not a picture"),
    "PostScript": (b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n", "is not read here"),
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
    assert answer == {"error": "the studio cannot keep this file: No space left on device"}


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
