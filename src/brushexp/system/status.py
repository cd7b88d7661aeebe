"""The states of a run, as recorded under ``status`` in its metrics.json."""

from enum import StrEnum


class Status(StrEnum):
    """The state of a run: at work, or the reason why it ended."""

    AT_WORK = "at work"  # state of a painting until its timelapse and page are written
    COMPLETED = "completed"
    STOPPED = "stopped"  # stopped by `State.stop` of brushexp.iterate
    STOPPED_EARLY = "stopped early"  # stopped by EarlyStopping or another callback
    PSNR_REACHED = "psnr reached"
    SECONDS_SPENT = "seconds spent"
    MAX_STEPS_REACHED = "max_steps reached"
    MAX_EPOCHS_REACHED = "max_epochs reached"
    MAX_TIME_REACHED = "max_time reached"
    INTERRUPTED = "interrupted"
    DIVERGED = "diverged"
    FAILED = "failed"


# States of runs that are excluded from comparisons.
UNFINISHED = (Status.FAILED, Status.INTERRUPTED, Status.DIVERGED, Status.AT_WORK)
