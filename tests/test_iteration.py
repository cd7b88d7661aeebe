"""Tests that ``brushexp.iterate`` yields states in order, stops when the caller does, and leaves no thread behind."""

import gc
import math
import subprocess
import sys
import threading
from itertools import islice

import numpy as np
import pytest
from refusals import refuses

import brushexp

SMALL = {"look": "plain", "resolution": 32, "strokes": 20, "steps": 4}


def painters() -> list[threading.Thread]:
    return [thread for thread in threading.enumerate() if thread.name == "brushexp"]


def test_states_come_in_order_those_of_another_painter_all_along_and_waiting_is_no_time_of_the_painting():
    states = [*brushexp.iterate("chelsea", every=10, painter="haeberli", **SMALL | {"strokes": 97})]
    assert len(states) > 8
    assert all(math.isfinite(state.psnr) for state in states)
    states = [*brushexp.iterate("chelsea", every=3, **SMALL | {"steps": 8})]
    assert [state.step for state in states] == [0, 3, 6, 8]
    assert [state.painting is None for state in states] == [True, True, True, False]
    assert [state.seconds for state in states] == sorted(state.seconds for state in states)
    assert states[2].psnr > states[0].psnr
    assert not np.array_equal(states[0].image, states[2].image)
    whole = brushexp.paint("chelsea", **SMALL | {"steps": 8})
    assert np.array_equal(states[-1].image, whole.image)
    assert not painters()
    states = brushexp.iterate("chelsea", every=1, **SMALL | {"steps": 30})
    first = next(states)
    threading.Event().wait(0.5)
    assert [*islice(states, 3)][-1].seconds - first.seconds < 0.4
    states.close()


@pytest.mark.parametrize("end", ["close", "forget", "stop"])
def test_a_painting_ends_when_nobody_wants_more(end):
    states = brushexp.iterate("chelsea", every=1, **SMALL | {"steps": 100_000})
    state = next(states)
    if end == "stop":
        state.stop()
        last = next(states)
        assert last.painting.metrics["status"] == "stopped"
        assert last.step < 100
        assert not [*states]
    elif end == "close":
        states.close()
    else:
        del states
        gc.collect()
    assert not painters()


def test_what_goes_wrong_is_raised_in_the_caller_and_a_program_ends_though_a_painting_does_not(monkeypatch):
    one_core = "import os; hasattr(os, 'sched_setaffinity') and os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})"
    paint = "brushexp.iterate('chelsea', every=1, look='plain', resolution=32, strokes=9, steps=10**6)"
    code = f"{one_core}; import brushexp; states = {paint}; next(states); next(states)"
    ended = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", code], check=True, timeout=200, stderr=subprocess.PIPE
    )
    assert b"Error" not in ended.stderr
    monkeypatch.setattr("brushexp.painting.finished.measure", lambda *_, **__: 1 / 0)
    states = brushexp.iterate("chelsea", every=2, **SMALL)
    with pytest.raises(ZeroDivisionError):
        list(states)
    monkeypatch.setattr("brushexp.painting.build.build_components", lambda _: (_ for _ in ()).throw(MemoryError))
    refuses("not enough memory; choose a smaller resolution=", next, brushexp.iterate("chelsea", **SMALL))
    assert not painters()
