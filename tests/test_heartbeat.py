"""Tests of the heartbeat: a terminal is never silent for long, and a pipe gets a line every ten seconds."""

import io
import os
import pty
import sys
import threading
import time

import pytest
from PIL import Image
from skimage import data

from brushexp.system import heartbeat as module
from brushexp.system.heartbeat import Heartbeat

LONGEST_SHARE = 0.15  # largest share of a run without a sign of life, over seven phases


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.fixture
def quick(monkeypatch):
    monkeypatch.setattr(module, "QUIET_SECONDS", 0.02)
    monkeypatch.setattr(module, "LINE_SECONDS", 0.02)
    monkeypatch.setattr(module, "TICK_SECONDS", 0.005)


def beat(stream, monkeypatch, during=lambda heart: None):
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setenv("TERM", "xterm")
    heart = Heartbeat()
    heart.start("preparing")
    time.sleep(0.2)
    during(heart)
    heart.end()
    return stream.getvalue()


def test_a_line_moves_on_a_terminal_and_is_taken_away_at_the_end(quick, monkeypatch):
    shown = beat(Terminal(), monkeypatch)
    assert "| preparing, 0 s" in shown
    assert "/ preparing, 0 s" in shown
    assert shown.endswith(module.CLEAR)


def test_lines_are_written_where_nothing_can_be_taken_back(quick, monkeypatch):
    shown = beat(io.StringIO(), monkeypatch)
    assert shown.startswith("preparing, 0 s so far\n")
    assert module.CLEAR not in shown


def test_nothing_is_shown_behind_a_bar_nor_after_the_end(quick, monkeypatch):
    def during(heart):
        with heart.paused():
            before = len(stream.getvalue())
            time.sleep(0.1)
            assert len(stream.getvalue()) == before

    stream = Terminal()
    end = len(beat(stream, monkeypatch, during))
    time.sleep(0.05)
    assert len(stream.getvalue()) == end


def test_a_closed_stream_ends_it(quick, monkeypatch):
    stream = Terminal()
    monkeypatch.setattr(sys, "stderr", stream)
    heart = Heartbeat()
    stream.close()
    heart.start("preparing")
    time.sleep(0.05)
    assert not any(thread.name == "heartbeat" for thread in threading.enumerate())


def test_it_does_not_run_in_a_process_that_is_forked():
    reader, writer = os.pipe()
    module.heartbeat.start("preparing")
    try:
        if (child := os.fork()) == 0:
            os.write(writer, b"ended" if module.heartbeat._ended is None else b"runs")
            os._exit(0)
        os.waitpid(child, 0)
    finally:
        module.heartbeat.end()
    assert os.read(reader, 10) == b"ended"


def test_a_terminal_is_never_silent_for_long(tmp_path):
    Image.fromarray(data.astronaut()).resize((3000, 2250)).save(tmp_path / "photo.jpg")
    words = ["-m", "brushexp", str(tmp_path / "photo.jpg"), f"output={tmp_path / 'run'}", "steps=10"]
    pid, terminal = pty.fork()
    if pid == 0:
        os.environ["TERM"] = "xterm"
        os.execv(sys.executable, [sys.executable, *words])
    start = last = time.monotonic()
    longest, shown = 0.0, b""
    while True:
        try:
            data_read = os.read(terminal, 2**16)
        except OSError:  # on Linux, when the other end is closed
            break
        if not data_read:
            break
        shown += data_read
        now = time.monotonic()
        longest, last = max(longest, now - last), now
    whole = time.monotonic() - start
    _, status = os.waitpid(pid, 0)
    assert status == 0, shown[-2000:]
    with Image.open(tmp_path / "run" / "painting.png") as painting:
        assert painting.size == (3000, 2250)
    assert longest < LONGEST_SHARE * whole, f"{longest:.1f} s of {whole:.1f} s"
