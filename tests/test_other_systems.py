"""Tests that the program starts without the modules and functions that only Unix provides."""

import subprocess
import sys

# A process without the names that Windows lacks, removed after PyTorch, whose build for Windows needs none of them.
CODE = """
import os, signal, sys
import torch

for name in ("register_at_fork", "getuid", "sched_getaffinity", "nice", "fork", "setpgrp"):
    delattr(os, name)
for name in ("pthread_sigmask", "SIGHUP", "SIGUSR1", "SIGUSR2"):
    delattr(signal, name)
for name in ("resource", "fcntl", "pwd", "grp", "termios"):
    sys.modules[name] = None

import brushexp
from brushexp.system import caches, runtime

assert runtime.cores() >= 1
assert runtime.free_memory() > 0
runtime._peak = lambda: 0.0 if runtime.resource is None else 1.0  # there is no /proc either
runtime.forget_peak_memory()
assert runtime.peak_memory() is None
assert caches.private_folder() is None
from brushexp.__main__ import main

sys.argv = ["brushexp", "--help"]
main()
"""


def test_the_help_is_shown_without_the_names_that_windows_lacks(tmp_path):
    done = subprocess.run([sys.executable, "-c", CODE], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "brushexp photo.jpg" in done.stdout
