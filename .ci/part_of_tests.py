"""Run only the tests that need no fixtures, for systems on which the other tests' fixtures cannot be created."""

import sys
from pathlib import Path

import pytest
import torch

from brushexp.config.publish import prepare

NAMES = ("gradient_check", "losses", "multiple_tests", "storage")

if __name__ == "__main__":
    prepare(Path())  # announces all plugins, as the tests expect
    torch.set_num_threads(1)
    options = ["--noconftest", "-n", "0", "-W", "ignore::pytest.PytestAssertRewriteWarning"]  # Hydra is imported here
    sys.exit(pytest.main([*options, *(f"tests/test_{name}.py" for name in NAMES)]))
