"""Threads: what one library does must not change what the other was told; and memory of one job, not of another."""

import subprocess
import sys

import numpy as np

from brushexp.system import runtime
from brushexp.system.runtime import forget_peak_memory, peak_memory

SCRIPT = """
import sys
import brushexp
import torch
from brushexp.plugins.blend.tiled import Tiled
Tiled()
assert "numba" not in sys.modules, "it takes a second to import, and comes with the first call of a kernel"
torch.set_num_threads(1)
from brushexp.plugins.engine.disc import Disc
Disc(window=8)(torch.zeros(2, 10), seed=0)
import numba
print(torch.get_num_threads(), numba.get_num_threads())
"""


def test_kernels_take_the_threads_of_torch_and_leave_them():
    result = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=True)
    assert result.stdout.split() == ["1", "1"]


def test_the_peak_of_a_job_is_not_that_of_one_before_it():
    forget_peak_memory()
    before = peak_memory() or runtime._earlier_peak[0]
    np.ones(2**29, np.uint8)
    first = peak_memory()
    assert first is None or 500 < first < before + 600
    forget_peak_memory()
    np.ones(2**20, np.uint8)
    assert (peak_memory() or 0) < (first or np.inf), "systems that cannot forget say that they do not know"
