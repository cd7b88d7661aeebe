"""Fixtures and settings shared by all tests."""

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

# The same examples in every run, so that failures come from changes and not from chance.
settings.register_profile("repeatable", derandomize=True)
settings.load_profile("repeatable")

if not torch.cuda.is_available():  # Triton decides when first imported whether to interpret its kernels
    os.environ["TRITON_INTERPRET"] = "1"

gc.disable()  # until tests begin: modules are never garbage, and searching them takes a fifth of the time
prepare(ROOT)  # at import, so that @parametrize can list the registered plugins
signal.signal(signal.SIGINT, signal.default_int_handler)  # tests started in the background may lack this handler
torch.set_num_threads(1)  # for tiny tensors, threads cost more than they save, especially on a busy machine


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Order the tests so that no worker is left with a long test at the end.

    Long tests that need kernels come first, so the first of two workers compiles and stores the kernels for both. The
    second worker starts in the middle, with the long tests that need no kernels.
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
    """Return a function that composes a config from overrides, as the command line would."""

    def compose_with(*overrides: str) -> DictConfig:
        return configured(expand_arguments(in_plain(overrides)))

    return compose_with


@pytest.fixture
def run_task(config, tmp_path, monkeypatch) -> Callable[..., dict[str, object]]:
    """Return a function that runs a task in this process and in ``tmp_path``, with few strokes in benchmarks."""

    def run(module: ModuleType, *overrides: str) -> dict[str, object]:
        monkeypatch.setattr("brushexp_training.evaluation.benchmark.ACROSS", 2)
        monkeypatch.setattr("brushexp_training.evaluation.benchmark.REPETITIONS", 1)
        cfg = config(*overrides)
        check(cfg, overrides)
        return perform(module, cfg, tmp_path, time.monotonic())

    return run
