"""How this process waits, keeps memory, shares threads and is interrupted: what no option of torch reaches."""

import ctypes
import logging
import os
import resource
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

log = logging.getLogger(__name__)

M_TRIM_THRESHOLD, M_MMAP_THRESHOLD = -1, -3  # names of malloc.h


def let_threads_sleep() -> None:
    """Make waiting threads of OpenMP sleep, not spin, which slows a busy machine; call it before torch is imported."""
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")


def keep_memory() -> None:
    """Let glibc keep freed pictures for the next step; else it returns blocks above 32 MB and faults them in again."""
    if sys.platform == "linux":
        libc = ctypes.CDLL(None)
        if hasattr(libc, "mallopt"):  # musl has none
            libc.mallopt(M_MMAP_THRESHOLD, 2**30)
            libc.mallopt(M_TRIM_THRESHOLD, 2**31 - 1)


def share_threads() -> None:
    """Let compiled kernels use as many threads as PyTorch does."""
    import numba  # noqa: PLC0415  (a second; --help should not wait for it)
    import torch  # noqa: PLC0415  (`let_threads_sleep` has to come first)

    n, most = torch.get_num_threads(), numba.config.NUMBA_NUM_THREADS  # type: ignore[attr-defined]
    numba.set_num_threads(max(1, min(n, most)))
    if torch.get_num_threads() != n:  # both share one pool of OpenMP, which Numba enlarges when it begins
        torch.set_num_threads(n)


@contextmanager
def interruptible(stop: Callable[[], None], promise: str) -> Iterator[None]:
    """Let the first Ctrl-C call ``stop`` and log the ``promise`` of an end in order; the second one ends at once."""

    def finish(signum: int, frame: FrameType | None) -> None:
        stop()
        signal.signal(signal.SIGINT, before)
        log.warning("%s (Ctrl-C again: at once)", promise)

    try:
        before = signal.signal(signal.SIGINT, finish)
    except ValueError:  # not the main thread: nobody can press Ctrl-C here
        yield
        return
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def peak_memory() -> float:
    """Most memory that this process has had at once, in MB."""
    status = Path("/proc/self/status")
    if status.exists():  # unlike getrusage it does not count what the parent had before it started us
        line = next(line for line in status.read_text().splitlines() if line.startswith("VmHWM"))
        return int(line.split()[1]) / 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (2**20 if sys.platform == "darwin" else 2**10)
