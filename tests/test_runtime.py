"""Threads: what one library does must not change what the other was told; and memory of one job, not of another."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

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


@pytest.mark.skipif(not Path("/proc/self/clear_refs").exists(), reason="only Linux forgets")
def test_the_peak_of_a_job_is_not_that_of_one_before_it():
    for megabytes in (300, 100):
        forget_peak_memory()
        before = peak_memory()
        np.ones(megabytes * 2**20, np.uint8)
        assert megabytes - 20 < peak_memory() - before < megabytes + 50
