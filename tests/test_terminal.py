"""What the terminal says: at once, in plain words, and with the figures left to run.log."""

import logging
import os
import sys
from io import BytesIO, StringIO, TextIOWrapper
from pathlib import Path

import pytest
from omegaconf import OmegaConf
from program import ended
from refusals import refuses

from brushexp.cli.opening import open_with, opening_line
from brushexp.results.runs import newest_run
from brushexp.runs.run_folder import take_name, warn_of_launcher
from brushexp.system.progress import showing
from brushexp.system.terminal import IN_LOG, Terminal, as_shown


@pytest.mark.parametrize(("typed", "said"), [
    ("", "painting astronaut in oil"),
    ("photo.jpg", "painting photo.jpg in oil"),
    ("photo.jpg watercolor finer", "painting photo.jpg in watercolour"),
    ("image=photo.jpg look=vangogh", "painting photo.jpg with look=vangogh"),
    ("coffee style=photo.jpg", "painting coffee in oil, in the style of photo.jpg"),
    ("photos", "painting the pictures of photos in oil"),
    ("a=b.jpg pastel", "painting a=b.jpg in pastel"),
    ("phto.jpg", ""),
    ("--help", ""),
    ("photo.jpg --cfg job", ""),
    ("export outputs/x", "beginning: export"),
    ("task=train minutes=3", "beginning: train"),
    ("-m seed=1,2", "checking the jobs of a sweep"),
    ("experiment=losses", "checking the jobs of a sweep"),
    ("resume=outputs/x", "going on with outputs/x"),
])  # fmt: skip
def test_the_first_line_says_what_begins(typed, said, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("photo.jpg", "a=b.jpg"):
        (tmp_path / name).touch()
    (tmp_path / "photos").mkdir()
    assert opening_line(typed.split()) == said


def test_letters_that_the_terminal_has_not_are_escaped_and_a_folder_that_is_gone_is_told_at_once(monkeypatch, tmp_path):
    monkeypatch.setattr(sys, "stdout", TextIOWrapper(BytesIO(), "ascii"))
    open_with(["coffee"])
    print("é\udcff.png", flush=True)
    assert sys.stdout.buffer.getvalue() == b"\\xe9\\udcff.png\n"
    (gone := tmp_path / "gone").mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    with pytest.raises(SystemExit, match="the folder where this was typed is gone; go to one that is there: cd"):
        open_with(["coffee"])


def test_the_terminal_gets_plain_words_and_leaves_figures_to_the_log(capsys, caplog, tmp_path, monkeypatch):
    log = logging.getLogger("plain")
    monkeypatch.setattr(log, "handlers", [Terminal()])
    monkeypatch.setattr(log, "propagate", False)
    log.setLevel(logging.INFO)
    log.info("writing the page")
    log.info("24.5 dB", extra=IN_LOG)
    for _ in range(2):  # as jobs of a sweep
        log.warning("it is slow")
    log.error("it is broken\nb\x1b[2J.png")
    assert capsys.readouterr() == ("writing the page\n", "note: it is slow\nbrushexp: it is broken\nb\\x1b[2J.png\n")
    with caplog.at_level(logging.INFO), showing("painting") as show:  # a pipe: no bar, but lines
        monkeypatch.setattr(logging.getLogger("brushexp.system.progress"), "handlers", [Terminal()])
        show(0.5, "step 3 of 6, 24.50 dB")
    assert "painting: 50 %, step 3 of 6, 24.50 dB, 0:00:00 left" in caplog.messages, "run.log has the figures"
    assert capsys.readouterr().out == "painting: 50 %, step 3 of 6, 0:00:00 left\n"
    monkeypatch.chdir(tmp_path)
    assert (as_shown(tmp_path / "a" / "b"), as_shown(tmp_path.parent)) == ("a/b", str(tmp_path.parent))


class Screen(StringIO):
    """A stream that is a terminal, or not."""

    def __init__(self, is_terminal):
        super().__init__()
        self.isatty = lambda: is_terminal


@pytest.mark.parametrize(("is_terminal", "kind", "letters", "has_bar"), [
    (True, "xterm", 100, True),
    (True, "xterm", 40, True),
    (True, "dumb", 80, False),
    (False, "xterm", 80, False),
])  # fmt: skip
def test_a_bar_is_for_terminals_that_can_show_it_and_says_the_time_on_narrow_ones(
    is_terminal, kind, letters, has_bar, monkeypatch, caplog
):
    for name, value in {"TERM": kind, "COLUMNS": str(letters), "FORCE_COLOR": "1"}.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(sys, "stderr", Screen(is_terminal))
    with caplog.at_level(logging.INFO), showing("painting the film") as show:
        show(0.5, "step 3 of 6")
        show(1.0, "step 6 of 6")
    shown = sys.stderr.getvalue()
    assert bool(shown) == has_bar
    assert has_bar == (not caplog.messages), "lines of the log stand for a bar"
    if has_bar:
        assert "100%" in shown
        assert "0:00:00" in shown.rpartition("left")[2]
        assert ("step 6 of 6" in shown) == (letters == 100)


@pytest.mark.parametrize("closed", [("stderr",), ("stdin", "stdout", "stderr")])
def test_streams_that_are_closed_stop_nothing(closed, monkeypatch):
    for name in closed:
        monkeypatch.setattr(sys, name, None)
    open_with(["coffee"])
    print("nobody reads it", file=sys.stderr)
    assert not sys.stderr.isatty()
    for name in closed:
        getattr(sys, name).close()


@pytest.mark.parametrize(("typed", "said"), [
    ([], []),
    (["hydra/launcher=joblib"], ["hydra/launcher=joblib"]),
    (["hydra/launcher=processes", "hydra.launcher.n_jobs=2"], ["jobs=2"]),
])  # fmt: skip
def test_a_launcher_of_a_single_run_is_told(typed, said, caplog):
    warn_of_launcher(OmegaConf.create({"hydra": {"overrides": {"hydra": typed}}}))
    told = "has no effect on one run; it is for several pictures, or for a sweep: -m seed=0,1"
    assert caplog.messages == [f"{word} {told}" for word in said]


def test_runs_of_one_second_have_folders_of_their_own_and_the_newest_is_found(config, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    first, second, named = config(), config(), config("output=outputs/mine")
    place = Path(first.output)
    OmegaConf.copy_cache(first, second)  # the same moment
    assert take_name(first, Path(first.output)) == place
    assert take_name(second, Path(second.output)) == Path(f"{place}_2")
    assert (first.output, second.output) == (str(place), f"{place}_2"), "and so for every job of a sweep"
    assert take_name(named, Path(named.output)) == Path("outputs/mine")
    refuses("no run is in outputs/ here; name what to look at: brushexp view FOLDER", newest_run)
    for folder, changed in ((place, 100), (Path(f"{place}_2"), 50)):
        (folder / "report.html").touch()
        os.utime(folder / "report.html", (changed, changed))
    assert newest_run() == place


def test_a_run_says_where_its_profile_is_and_goes_on_in_its_own_folder(tmp_path):
    words = ["chelsea", "resolution=16", "strokes=4", "steps=3", "frames=0", "threads=1", "report=false", "output=a"]
    code, output = ended(tmp_path, *words, "trainer.profiler=simple")
    assert code == 0, output
    assert "a/profile.txt  where the time was spent" in output
    assert "FIT Profiler Report" in (tmp_path / "a" / "profile.txt").read_text()
    kill = ("checkpoint.ckpt", 1, True)
    assert ended(tmp_path, *words[:-1], "output=b", "checkpoint_every=0", kill=kill)[0] < 0
    code, output = ended(tmp_path, "resume=b")
    assert code == 0, output
    assert "b/painting.png" in output
    assert not (tmp_path / "outputs").exists()
