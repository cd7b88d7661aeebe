"""Fixtures every test may use, and what holds while tests run."""

import gc
import os
import signal
import time
from collections.abc import Callable
from types import ModuleType

import pytest
import torch
from browser import browser, opened  # noqa: F401  (fixtures)
from hypothesis import settings
from omegaconf import DictConfig
from program import ROOT, in_plain
from typed import configured

from brushexp.cli.program import expand_arguments
from brushexp.config.check import check
from brushexp.config.publish import prepare
from brushexp.runs.runner import perform

# The same examples at every run: a failure is one of the change, and not of chance.
settings.register_profile("repeatable", derandomize=True)
settings.load_profile("repeatable")

if not torch.cuda.is_available():  # Triton interprets its kernels then, and decides so when it is first imported
    os.environ["TRITON_INTERPRET"] = "1"

gc.disable()  # until tests begin: modules are no garbage, and to look for it takes a fifth of the time
prepare(ROOT)  # at import, so that @parametrize can list what is registered
signal.signal(signal.SIGINT, signal.default_int_handler)  # tests that run in the background may begin without it
torch.set_num_threads(1)  # tiny tensors: threads cost more than they give, most of all on a busy machine


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Long tests come first, so that no worker is left alone with one at the end.

    The second of two workers begins in the middle, with those that need no kernels: the first compiles them meanwhile,
    and what it stores the second need not compile.
    """
    first, second, others = [], [], []
    for item in sorted(items, key=lambda item: item.path):
        mark = item.get_closest_marker("slow")
        (others if mark is None else first if mark.kwargs.get("kernels", True) else second).append(item)
    half = max(len(items) // 2 - len(first), 0)
    items[:] = [*first, *others[:half], *second, *others[half:]]


def pytest_collection_finish() -> None:
    gc.freeze()
    gc.enable()


@pytest.fixture(autouse=True)
def _seeded() -> None:
    torch.manual_seed(0)


@pytest.fixture
def config() -> Callable[..., DictConfig]:
    """Compose a config with overrides, as the command line would."""

    def compose_with(*overrides: str) -> DictConfig:
        return configured(expand_arguments(in_plain(overrides)))

    return compose_with


@pytest.fixture
def run_task(config, tmp_path, monkeypatch) -> Callable[..., dict[str, object]]:
    """Run the task of a module in this process; its folder is ``tmp_path``, and speed is measured on few strokes."""

    def run(module: ModuleType, *overrides: str) -> dict[str, object]:
        monkeypatch.setattr("brushexp_training.evaluation.benchmark.ACROSS", 2)
        monkeypatch.setattr("brushexp_training.evaluation.benchmark.REPETITIONS", 1)
        cfg = config(*overrides)
        check(cfg, overrides)
        return perform(module, cfg, tmp_path, time.monotonic())

    return run
