"""Threads: what one library does must not change what the other was told."""

import subprocess
import sys

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
