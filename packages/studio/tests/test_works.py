"""Paintings of the studio and what is wished of them, without a browser."""

import re
import sys
from threading import Event
from unittest.mock import Mock

import numpy as np
import pytest
from brushexp_studio import task as studio_task
from omegaconf import OmegaConf
from refusals import refuses

from brushexp.errors import UserError

pytest.importorskip("nicegui", reason="the studio is an extra")
from brushexp_studio.tab import likelihood
from brushexp_studio.visit import Visit
from brushexp_studio.wishes import Wishes
from brushexp_studio.works import Work, Works


def test_paintings_wait_for_their_turn_and_stop_is_for_those_of_ones_own_tab(tmp_path, monkeypatch):
    gate = Event()
    monkeypatch.setattr(Works, "_paint", lambda works, work: gate.wait(60))
    works = Works(tmp_path, {})
    mine, theirs = (Visit(Mock(), works, [], Wishes(photo=Mock())) for _ in range(2))
    mine.arrive("first")
    mine.begun = works.begin(mine.wishes, mine)
    theirs.begun = works.begin(theirs.wishes, theirs)
    last = works.begin(theirs.wishes, theirs)
    theirs.work = mine.begun
    assert (theirs.stoppable(), mine.stoppable()) == (theirs.begun, mine.begun), "each its own"
    assert works.before(last) == 2
    works.stop(theirs.begun)
    assert [work.number for work in works.all] == [1, 3], "what waits is withdrawn"
    assert theirs.stoppable() is None, "the other tab is open"
    mine.is_there = False
    assert theirs.stoppable() is mine.begun, "the tab is gone"
    again = Visit(Mock(), works, [])
    again.join()  # before it is known whose it is
    again.arrive("first")
    assert again.stoppable() is again.work is mine.begun, "it was loaded again, while others wait"
    assert theirs.stoppable() is None
    gate.set()
    works._thread.join(60)
    assert {work.status for work in works.all} == {"done"}
    assert sorted(["plain", "oil", "own", "ink"], key=likelihood) == ["oil", "ink", "plain", "own"]


def test_before_the_first_step_stands_what_a_network_lays_where_a_draft_begins_with_it(tmp_path, monkeypatch):
    photo = Mock(path="chelsea", size=(300, 451))
    oil = Wishes(photo=photo, seconds=9.0, side=64)
    assert oil.at_a_glance() == {"look": "oil", "resolution": 64, "frames": 60, "quality": "draft"}
    others = ({"look": "ink"}, {"quality": "draft"}, {"size": 2.0})
    assert [Wishes(photo=photo, **other).at_a_glance() for other in others] == [None] * 3
    larger = Wishes(photo=photo, quality="draft", size=2.0).overrides()
    assert (larger["init"], larger["init.length"]) == ("layers", 8), "sizes are those of the look's own start"
    asked = []

    def iterate(_, **keys):
        asked.append(keys)
        yield Mock(
            image=np.zeros((4, 6, 3), np.uint8), psnr=20.0 + len(asked), strokes=[], step=0, steps=1, painting=None
        )

    monkeypatch.setattr("brushexp.iterate", iterate)
    work = Work(1, oil, tmp_path)
    Works(tmp_path, {})._paint(work)
    assert [keys.get("quality") for keys in asked] == ["draft", None]
    assert {number: caption[:20] for number, (_, caption) in work.frames.items()} == {
        -1: "at a glance · 21.0 d", 0: "step 0 of 1 · 22.0 d",
    }  # fmt: skip


def test_a_painting_is_printed_large_once(tmp_path):
    work = Work(1, Wishes(photo=Mock()), tmp_path)
    with pytest.raises(KeyError):
        work.print_as("png")

    def export(form, folder, size):
        folder.mkdir(exist_ok=True)
        path = folder / f"painting.{form}"
        path.write_text(f"{path.exists()} {size}")
        return [path]

    work.painting = Mock(export=export)
    assert [work.print_as("pdf").read_text() for _ in range(2)] == ["False 4096"] * 2
    with pytest.raises(KeyError):
        work.print_as("../x")


@pytest.mark.parametrize("keep", ["/proc/x", __file__])
def test_a_folder_that_cannot_keep_paintings_is_refused_before_there_are_any(tmp_path, keep):
    with pytest.raises(UserError, match=f"cannot write into keep={re.escape(keep)}: .*; choose another folder"):
        studio_task.run(OmegaConf.create({"keep": keep}), tmp_path, 0.0)


def test_without_the_extra_it_says_what_to_install(tmp_path, monkeypatch):
    for module in ("nicegui", "brushexp_studio.server"):
        monkeypatch.setitem(sys.modules, module, None)
    refuses(r"pip install 'brushexp\[studio\]'", studio_task.run, OmegaConf.create(), tmp_path, 0.0)
