"""Threads, memory and devices."""

from brushexp.system.device import device_of
from brushexp.system.runtime import (
    check_memory,
    cores,
    give_memory_back,
    interruptible,
    jobs_at_once,
    keep_memory,
    peak_memory,
    share,
    use_threads,
)

__all__ = [
    "check_memory",
    "cores",
    "device_of",
    "give_memory_back",
    "interruptible",
    "jobs_at_once",
    "keep_memory",
    "peak_memory",
    "share",
    "use_threads",
]
