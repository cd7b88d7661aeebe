"""What one library or job does must not change what another was told: threads, packages, memory."""

import importlib
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from importlib.util import find_spec

import numpy as np
import pytest
from lightning_utilities.core.imports import RequirementCache
from omegaconf import OmegaConf

from brushexp.compat.hidden_packages import hidden
from brushexp.runs.runner import explaining_to_users
from brushexp.system import runtime
from brushexp.system.runtime import end_on_signals, forget_peak_memory, peak_memory, share

SCRIPT = """
import sys
import brushexp
import torch
from brushexp.plugins.blend.tiled import Tiled
Tiled()
assert "numba" not in sys.modules, "it takes a second to import, and comes with the first call of a kernel"
torch.set_num_threads(1)
from brushexp_training.engine.disc import Disc
Disc(window=8)(torch.zeros(2, 10), seed=0)
assert torch.get_num_threads() == 1
"""
FORKS = """
import multiprocessing
import brushexp
import torch

def paint(seed):
    torch.rand(2**20).exp()  # by all threads
    painting = brushexp.paint("astronaut", strokes=40, resolution=32, steps=2, seed=seed, threads=2, look="plain")
    return painting.strokes.position.numpy().tobytes()

if __name__ == "__main__":
    own = paint(0)
    with multiprocessing.get_context("fork").Pool(2) as pool:
        assert pool.map(paint, [0, 0, 1])[:2] == [own, own]
"""


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere libraries do not survive a fork")
def test_kernels_are_loaded_at_their_first_call_and_a_fork_paints_after_a_painting():
    subprocess.run([sys.executable, "-c", SCRIPT], check=True)
    subprocess.run([sys.executable, "-c", FORKS], check=True)


@pytest.mark.parametrize("threads", [1, 2, 3])
@pytest.mark.parametrize("n", [0, 1, 2, 7, 100])
def test_threads_share_all_work_and_do_nothing_twice(threads, n, monkeypatch):
    monkeypatch.setattr("torch.get_num_threads", lambda: threads)
    done = np.zeros(n, int)

    def work(begin, end, step):
        done[begin:end] += step

    share(work, n, 1)
    assert (done == 1).all()


def test_a_mistake_in_any_thread_is_told_and_work_is_done_where_no_more_threads_are_to_be_had(monkeypatch):
    monkeypatch.setattr("torch.get_num_threads", lambda: 3)

    def work(begin, end):
        time.sleep(0.001)  # so that all threads take part
        assert end < 50

    with pytest.raises(AssertionError):
        share(work, 50)
    monkeypatch.setattr("torch.get_num_threads", lambda: 3)
    monkeypatch.setattr(runtime, "_pool", lambda: ended)
    ended, done = ThreadPoolExecutor(1), np.zeros(9, int)
    ended.shutdown()
    share(lambda begin, end: done[begin:end].__iadd__(1), 9)
    assert (done == 1).all()


def test_an_interruption_that_a_callback_loses_comes_again(monkeypatch):
    monkeypatch.setattr("brushexp.system.runtime.ENDING", [])
    monkeypatch.setattr(sys, "unraisablehook", lambda lost: others.append(lost.exc_type))
    others = []

    class Lost:
        def __init__(self, error):
            self.error = error

        def __del__(self):
            raise self.error

    end_on_signals()
    Lost(ValueError())
    with pytest.raises(KeyboardInterrupt):  # noqa: PT012
        Lost(KeyboardInterrupt())
        time.sleep(20)
    assert others == [ValueError]
    with pytest.raises(KeyboardInterrupt), explaining_to_users(OmegaConf.create()):  # noqa: PT012
        Lost(KeyboardInterrupt())
        raise RuntimeError("no compiled object yet")
    time.sleep(2 * runtime.MOMENT)  # it is not raised a second time


def test_the_peak_of_a_job_is_not_that_of_one_before_it():
    forget_peak_memory()
    before = peak_memory() or runtime._earlier_peak[0]
    np.ones(2**29, np.uint8)
    first = peak_memory()
    assert first is None or 500 < first < before + 600
    forget_peak_memory()
    np.ones(2**20, np.uint8)
    assert (peak_memory() or 0) < (first or np.inf), "systems that cannot forget say that they do not know"


def test_a_hidden_package_looks_as_if_it_were_not_installed_to_lightning_alone_and_a_loaded_one_stays():
    assert "xmlrpc" not in sys.modules
    with hidden("xmlrpc", "mkdocs", "torch"):
        assert not RequirementCache("mkdocs>=0.1")
        assert not RequirementCache(module="xmlrpc.client")
        assert RequirementCache("torch>=2")
        importlib.import_module("xmlrpc.server")  # a task may need it
    assert find_spec("xmlrpc") is not None
    assert RequirementCache("mkdocs>=0.2")
