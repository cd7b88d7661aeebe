"""Test that ``task=view`` serves the page of a catalogue, a run or a sweep, and only to this machine."""

import os
import re
import signal
import socket
import time
from pathlib import Path
from urllib.parse import urlsplit

import pytest
import torch
from brushexp_studio.serving import serve
from brushexp_studio.view import newest_run, pages_of
from omegaconf import OmegaConf
from program import Program, ask
from refusals import refuses
from scenes import random_strokes
from sweeps import make_run

from brushexp.errors import UserError
from brushexp.strokes.storage import Saved, save_catalogue


def make_catalogue(path, renderer="analytic", config="renderer: {taper: 0.5}\n"):
    depth = torch.arange(3, dtype=torch.int32)
    save_catalogue(path, Saved(random_strokes(3, (32, 48)), depth, (32, 48), torch.ones(3), renderer, "", 0, config))
    return path


def painted_run(folder, **chosen):
    make_run(folder.parent, chosen, name=folder.name, target=90, color=90, size=(32, 48), psnr=20.0, seconds=1.0)
    make_catalogue(folder / "catalogue.h5")
    return folder


def pages(config, catalogue, into, *overrides):
    into.mkdir(exist_ok=True)
    return pages_of(config("task=view", f"catalogue='{catalogue}'", *overrides), catalogue, into)


def test_the_newest_run_is_found(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    refuses("there is no run in outputs/; name one to view: brushexp view FOLDER", newest_run)
    places = [Path("outputs/a"), Path("outputs/b")]
    for folder, changed in zip(places, (100, 50), strict=True):
        folder.mkdir(parents=True)
        (folder / "report.html").touch()
        os.utime(folder / "report.html", (changed, changed))
    assert newest_run() == places[0]


def test_a_page_is_served_to_this_machine_and_nothing_else(tmp_path):
    (tmp_path / "report.html").write_text("<p>é", encoding="utf-8")
    (tmp_path / "secret.txt").write_text("secret")
    (tmp_path / "link.html").symlink_to(tmp_path / "secret.txt")
    (tmp_path / "folder.html").mkdir()
    pages = {"/": "report.html", "/a b/gone.html": "gone.html", "/link.html": "link.html", "/folder": "folder.html"}
    with serve({name: tmp_path / file for name, file in pages.items()}) as address:
        port = urlsplit(address).port
        status, body, head = ask(address, "/?from=here")
        assert (status, body) == (200, "<p>é".encode())
        assert head["Content-Type"] == "text/html; charset=utf-8"
        assert "connect-src" not in head["Content-Security-Policy"]
        assert "default-src 'none'" in head["Content-Security-Policy"]  # an untrusted page cannot read other pages
        for path in ("//[", "/secret.txt", "/report.html", "/../secret.txt", "/%2e%2e/secret.txt", "/a%20b/gone.html"):
            assert ask(address, path)[0] == 404, path
        assert [ask(address, path)[0] for path in ("/link.html", "/folder")] == [404, 404], "links may lead anywhere"
        assert ask(address, "/", method="POST")[0] == 501
        assert ask(address, "/", Host="evil.example")[0] == 403  # its name may resolve to this machine
        assert ask(address, "/", Host=f"localhost:{port}")[0] == 200
        with socket.socket() as other, pytest.raises(OSError, match="refused"):
            other.connect(("127.0.0.2", port))  # another address of this machine
        with pytest.raises(UserError, match=rf"port={port} is not available .*port=0"), serve({}, port):
            pass
    with pytest.raises(OSError, match="refused"):
        ask(address, "/")


def test_a_catalogue_is_drawn_by_its_own_renderer(tmp_path, config):
    path = make_catalogue(tmp_path / "strokes <b>.h5")
    by_address = pages(config, path, tmp_path / "out")
    assert by_address == {"/": tmp_path / "out" / "report.html"}
    html = by_address["/"].read_text()
    assert "strokes &lt;b&gt;" in html
    assert "strokes <b>" not in html
    run = painted_run(tmp_path / "run")
    before = sorted(run.iterdir())
    assert "20.00" in pages(config, run, tmp_path / "out")["/"].read_text(), "its PSNR"
    assert sorted(run.iterdir()) == before, "the folder may be read-only"


def test_a_renderer_that_is_not_here_is_named_and_another_one_helps(tmp_path, config):
    path = make_catalogue(tmp_path / "a.h5", "watercolour")
    with pytest.raises(UserError, match=r"renderer=watercolour, which cannot be built here: .*renderer=analytic"):
        pages(config, path, tmp_path / "out")
    assert pages(config, path, tmp_path / "out", "renderer=analytic")["/"].is_file()
    path = make_catalogue(tmp_path / "b.h5", "neural", "renderer: {checkpoint: gone.safetensors}\n")
    refuses(r"gone\.safetensors.*there is no such file", pages, config, path, tmp_path / "out")
    (tmp_path / "empty").mkdir()
    refuses("neither a run nor a sweep", pages, config, tmp_path / "empty", tmp_path / "out")


@pytest.mark.parametrize(("name", "path"), [("sweep é", "sweep%20%C3%A9"), (os.fsdecode(b"sw\xe9"), "sw%E9")])
def test_the_folder_of_a_sweep_is_shown_with_the_pages_of_its_runs(tmp_path, name, path):
    runs = [painted_run(tmp_path / name / str(k), steps=str(k)) for k in range(2)]
    (runs[1] / "report.html").write_text("page of run 1")
    (tmp_path / "out").mkdir()
    by_address = pages_of(OmegaConf.create(), tmp_path / name, tmp_path / "out")
    assert f'href="../{path}/1/report.html"' in by_address["/"].read_text()
    with serve(by_address) as address:
        assert ask(address, "/")[0] == 200
        assert ask(address, f"/{path}/1/report.html")[1] == b"page of run 1"
        assert ask(address, f"/{path}/0/report.html")[0] == 404
        assert ask(address, f"/{path}/1/catalogue.h5")[0] == 404


def test_the_program_serves_until_ctrl_c(tmp_path):
    words = [f"catalogue={make_catalogue(tmp_path / 'catalogue.h5')}", f"output={tmp_path}/out", "threads=1"]
    process = Program("task=view", "open=false", *words, cwd=tmp_path)
    log, address = tmp_path / "out" / "run.log", None
    while not address and process.poll() is None:
        time.sleep(0.05)
        address = re.search(r"http://\S+", log.read_text()) if log.is_file() else None
    assert ask(address[0], "/")[:2] == (200, (tmp_path / "out" / "report.html").read_bytes())
    process.send_signal(signal.SIGINT)
    out, err = process.communicate()
    assert process.returncode == 0, err
    assert "no longer served" in out
