"""Control how this process waits, keeps memory, shares work among threads and responds to interruptions."""

import ctypes
import logging
import os
import signal
import sys
import threading
from _thread import interrupt_main
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from types import FrameType

from brushexp.errors import UserError

try:
    import resource
except ImportError:  # on Windows
    resource = None  # type: ignore[assignment]

log = logging.getLogger(__name__)

ENDING = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]
CLUSTER_SIGNALS = [getattr(signal, name) for name in ("SIGUSR1", "SIGUSR2") if hasattr(signal, name)]  # from clusters
NO_LIMIT = 2**44  # MB of memory to assume if the system states no limit
M_TRIM_THRESHOLD, M_MMAP_THRESHOLD = -1, -3  # options of mallopt(3)
MOMENT = 0.05  # seconds before a lost interruption is raised again
THREADS = 256  # largest number of threads for kernels
PARTS_PER_THREAD = 4  # parts of a kernel's work per thread, so that no thread waits long for another
_received: list[int] = []  # signals received so far
_lost = threading.Event()  # set by an interruption that was lost in a callback from C
_most_threads = [THREADS]
_used_threads = [1]  # largest number of threads that a job of this process has used
_earlier_peak = [0.0]  # peak memory of earlier jobs in MB


def let_threads_sleep() -> None:
    """Make idle OpenMP threads sleep, because spinning slows a busy machine; call this before importing torch."""
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")


def keep_memory(most: int = 2**30) -> None:
    """Let glibc keep freed blocks of up to ``most`` bytes for reuse; larger blocks return to the system at once."""
    if sys.platform == "linux":
        libc = ctypes.CDLL(None)
        if hasattr(libc, "mallopt"):  # musl lacks mallopt
            libc.mallopt(M_MMAP_THRESHOLD, most)
            libc.mallopt(M_TRIM_THRESHOLD, 2**31 - 1)


def give_memory_back() -> None:
    """Return freed memory to the system; otherwise it fragments, since each picture needs blocks of other sizes."""
    if sys.platform == "linux" and hasattr(libc := ctypes.CDLL(None), "malloc_trim"):
        libc.malloc_trim(0)


def share(work: Callable[..., object], n: int, *args: object) -> None:
    """Split ``range(n)`` and call ``work(begin, end, *args)`` for each part, on as many threads as PyTorch uses.

    Threads run in parallel only while ``work`` releases Python's global lock, as compiled functions do. Any thread may
    run any part, so the parts must be independent.
    """
    import torch  # noqa: PLC0415  (`let_threads_sleep` has to come first)

    threads = min(torch.get_num_threads(), n)
    if threads < 2:
        work(0, n, *args)
        return
    count = min(PARTS_PER_THREAD * threads, n)
    numbers = iter(range(count))  # gives each part to one thread

    def take_parts() -> None:
        for k in numbers:
            work(k * n // count, (k + 1) * n // count, *args)

    helpers = []
    with suppress(RuntimeError):  # new threads may be impossible, for example at exit
        for _ in range(threads - 1):
            helpers.append(_pool().submit(take_parts))
    take_parts()
    for helper in helpers:
        if not helper.cancel():
            helper.result()


@cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(THREADS, "brushexp")


def use_threads(n: int) -> None:
    """Let PyTorch and the kernels use ``n`` threads, or one thread in a process forked from a multi-threaded one."""
    import torch  # noqa: PLC0415

    torch.set_num_threads(min(n, _most_threads[0]))
    _used_threads[0] = max(_used_threads[0], torch.get_num_threads())


def _reset_threads() -> None:
    """Discard the parent's threads after a fork, because OpenMP would wait for them forever."""
    _pool.cache_clear()
    if "torch" in sys.modules and max(_used_threads[0], sys.modules["torch"].get_num_threads()) > 1:
        _most_threads[0] = 1
        use_threads(1)


if hasattr(os, "register_at_fork"):  # Windows does not fork
    os.register_at_fork(after_in_child=_reset_threads)


def end_on_signals() -> None:
    """Make SIGTERM and SIGHUP raise KeyboardInterrupt unless they are ignored, as under nohup.

    Clusters send SIGTERM, and terminals send SIGHUP. If a library loses an interruption (in a callback from C, or
    while it frees memory), the interruption is raised again a moment later.
    """
    others = sys.unraisablehook

    def raise_again(lost: "sys.UnraisableHookArgs") -> None:
        if issubclass(lost.exc_type, KeyboardInterrupt):
            _lost.set()
            threading.Timer(MOMENT, lambda: interrupt_main() if pop_lost_interrupt() else None).start()
        else:
            others(lost)

    def interrupt(signum: int, frame: FrameType | None) -> None:
        _received.append(signum)
        raise KeyboardInterrupt

    sys.unraisablehook = raise_again
    for number in ENDING:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, interrupt)


def pop_lost_interrupt() -> bool:
    """Return whether an interruption was lost, and clear the flag; the caller must then raise it again."""
    was_lost = _lost.is_set()
    _lost.clear()
    return was_lost


def received_signal() -> bool:
    """Return whether this process has received a signal to stop."""
    return bool(_received)


def interrupted_code() -> int:
    """Return the exit code of an interrupted process: 128 plus the signal's number, or 130 after Ctrl-C."""
    return 128 + (_received[-1] if _received else signal.SIGINT)


def reraise_signal() -> None:
    """Resend the cluster signal that interrupted this process, so that submitit requeues the job."""
    if _received and _received[-1] in CLUSTER_SIGNALS:
        signal.raise_signal(_received[-1])


@contextmanager
def interruptible(stop: Callable[[], None], promise: str) -> Iterator[None]:
    """Call ``stop`` and log ``promise`` on the first Ctrl-C, SIGTERM or SIGHUP; a second signal acts at once.

    SIGUSR1 and SIGUSR2, which clusters send, have the same effect if they have a handler.
    """

    def finish(signum: int, frame: FrameType | None) -> None:
        _received.append(signum)
        stop()
        restore()
        log.warning("%s (press Ctrl-C again to stop at once)", promise)

    def restore() -> None:
        for number, handler in before.items():
            signal.signal(number, handler)

    handled = [number for number in CLUSTER_SIGNALS if callable(signal.getsignal(number))]
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, *ENDING, *handled)}
    if threading.current_thread() is not threading.main_thread():  # only the main thread receives signals
        yield
        return
    for number, handler in before.items():
        if handler is not signal.SIG_IGN:
            signal.signal(number, finish)
    try:
        yield
    finally:
        restore()


@contextmanager
def delayed_interrupt(promise: str) -> Iterator[None]:
    """Delay the first Ctrl-C, SIGTERM or SIGHUP: log ``promise``, and raise KeyboardInterrupt after the block."""
    pressed = threading.Event()
    with interruptible(pressed.set, promise):
        yield
    if pressed.is_set():
        raise KeyboardInterrupt


def cores() -> int:
    """Return the number of CPU cores available to this process."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def jobs_at_once(n_jobs: int) -> int:
    """Return how many jobs run in parallel; for ``n_jobs``, -1 means one per core, -2 one fewer, and so on."""
    return n_jobs if n_jobs > 0 else max(1, cores() + 1 + n_jobs)


def free_memory() -> float:
    """Return how many MB this process may still allocate, or `NO_LIMIT` if that is unknown."""
    limits: list[float] = [NO_LIMIT]
    if resource is not None:
        limits.append(resource.getrlimit(resource.RLIMIT_AS)[0] % 2**64 / 2**20)  # -1 means no limit
    limit, info = Path("/sys/fs/cgroup/memory.max"), Path("/proc/meminfo")
    if limit.exists() and (text := limit.read_text().strip()).isdecimal():
        limits.append(int(text) / 2**20)
    if info.exists():
        lines = dict(line.split(":") for line in info.read_text().splitlines())
        limits.append(sum(int(lines[name].split()[0]) for name in ("MemAvailable", "SwapFree")) / 1024)
    return min(limits)


def check_memory(needed: float, what: str, cure: str) -> None:
    """Raise a UserError if work needs more bytes of memory than this process may still allocate."""
    free = free_memory()
    if needed > free * 2**20:
        gigabytes = f"{needed / 2**30:.1f} GB of memory, but only {free / 1024:.1f} GB are free"
        raise UserError(f"{what} need at least {gigabytes}; {cure}")


def forget_peak_memory() -> None:
    """Reset `peak_memory` before this process starts its next job."""
    with suppress(OSError):  # only some systems have this file
        Path("/proc/self/clear_refs").write_text("5")
    _earlier_peak[0] = _peak()


def peak_memory() -> float | None:
    """Return the peak memory of this process in MB; None if it is unknown, or if an earlier job used as much."""
    peak = _peak()
    return peak if peak > _earlier_peak[0] else None


def _peak() -> float:
    status = Path("/proc/self/status")
    if status.exists():  # unlike getrusage, this excludes the parent's memory before the fork
        line = next(line for line in status.read_text().splitlines() if line.startswith("VmHWM"))
        return int(line.split()[1]) / 1024
    if resource is None:
        return 0.0
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (2**20 if sys.platform == "darwin" else 2**10)
