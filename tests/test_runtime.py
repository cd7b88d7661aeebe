"""What one library or job does must not change what another was told: threads, packages, memory."""

import subprocess
import sys
from importlib.util import find_spec

import numpy as np
from lightning_utilities.core.imports import RequirementCache

from brushexp.compat.hidden_packages import hidden
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


def test_a_hidden_package_looks_as_if_it_were_not_installed_and_a_loaded_one_stays():
    with hidden("xmlrpc", "mkdocs", "torch"):
        assert not RequirementCache("mkdocs>=0.1")
        assert find_spec("xmlrpc") is None
        assert find_spec("torch") is not None
        assert RequirementCache("torch>=2")
    assert find_spec("xmlrpc") is not None
    assert RequirementCache("mkdocs>=0.2")
