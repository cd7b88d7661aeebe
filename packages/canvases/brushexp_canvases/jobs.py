"""Paint a canvas on the workers of a Dask cluster, starting each tile as soon as its predecessors are painted."""

from __future__ import annotations

import gc
import logging
import math
import signal
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from shutil import which
from typing import TYPE_CHECKING, Any

import numpy as np

from brushexp.contracts import UserError
from brushexp.contracts.machine import give_memory_back
from brushexp_canvases.grid import Grid, Tile
from brushexp_canvases.tile import Canvas, draw_tile, paint_tile

if TYPE_CHECKING:
    from distributed import Client, Future

SILENT = logging.CRITICAL + 1  # log level of workers; their errors reach us anyway
ANY_PORT = "127.0.0.1:0"  # address of Dask's dashboard; a free port lets several canvases be painted at once
SLIM = {"distributed.worker.profile.enabled": False}  # profiling makes a worker's memory grow with its tiles
WAIT = "10s"  # timeout for connecting to a scheduler
SLURM = "slurm"  # value of cluster= that is not an address
MEMORY = "4GB"  # memory of a Slurm job, unless Dask's settings say otherwise
MOST_DEATHS = 3  # number of workers that one tile may kill; Dask's own default


@contextmanager
def workers(n: int, address: str | None) -> Iterator[Client]:
    """Start ``n`` single-threaded workers on this machine or through Slurm, or connect to an existing scheduler."""
    try:
        from dask import config  # noqa: PLC0415  (the extra ``canvas``)
        from distributed import Client, LocalCluster  # noqa: PLC0415
    except ImportError as error:
        raise UserError("canvas= needs Dask; install it with: pip install 'brushexp[canvas]'") from error
    for name in (*(name for name in logging.root.manager.loggerDict if name.startswith("distributed")), "asyncio"):
        logging.getLogger(name).setLevel(SILENT)  # errors are reported by `paint_all`
    with ExitStack() as stack:
        if address in (None, SLURM):
            stack.enter_context(config.set(SLIM))
            local = {"threads_per_worker": 1, "dashboard_address": ANY_PORT, "silence_logs": SILENT}
            with blocked_interrupts():
                cluster = stack.enter_context(_by_slurm(n) if address == SLURM else LocalCluster(n_workers=n, **local))
            yield stack.enter_context(Client(cluster))
            return
        try:
            client = stack.enter_context(Client(address, timeout=WAIT))
        except (OSError, ValueError) as error:
            cure = "start one with: dask scheduler; or leave out cluster="
            raise UserError(f"cluster={address} has no scheduler that answers ({error}); {cure}") from error
        yield client


@contextmanager
def blocked_interrupts() -> Iterator[None]:
    """Block Ctrl-C within the ``with`` block, and permanently in threads and processes started there.

    Without this, child processes would be interrupted too, because terminals send Ctrl-C to all of them.
    """
    if not hasattr(signal, "pthread_sigmask"):  # on Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _by_slurm(n: int) -> Any:
    """Submit ``n`` Slurm jobs, one per worker; a job that ends is resubmitted."""
    at_interrupt = signal.getsignal(signal.SIGINT)
    try:
        from dask import config  # noqa: PLC0415  (the extra ``slurm``)
        from dask_jobqueue.slurm import SLURMCluster  # noqa: PLC0415
    except ImportError as error:
        needed = "cluster=slurm needs dask-jobqueue; install it with: pip install 'brushexp[canvas,slurm]'"
        raise UserError(needed) from error
    finally:
        signal.signal(signal.SIGINT, at_interrupt)  # importing dask-jobqueue changes it
    if which("sbatch") is None:
        raise UserError("cluster=slurm needs sbatch, which is not installed here; start on a machine that has it")
    memory = config.get("jobqueue.slurm.memory", None) or MEMORY
    scheduler = {"dashboard_address": ANY_PORT}
    cluster = SLURMCluster(cores=1, processes=1, memory=memory, silence_logs=SILENT, scheduler_options=scheduler)
    cluster.adapt(minimum_jobs=n, maximum_jobs=n)
    return cluster


def paint_all(client: Client, canvas: Canvas, grid: Grid, todo: Sequence[Tile], show: Callable[[int], None]) -> float:
    """Paint and draw the remaining tiles in ``todo``, and pass the number of finished jobs to ``show``.

    A tile is painted after its neighbours from earlier rounds (`Grid.before`), and drawn after all its neighbours. If a
    worker dies, it is replaced and its tile is repainted. Returns the highest peak memory of any worker in MB, or NaN
    if the system does not report it.
    """
    painted: dict[Tile, Future] = {}
    for tile in todo:
        needed = [painted[other] for other in grid.before(tile) if other in painted]
        painted[tile] = client.submit(do_job, paint_tile, canvas, tile, *needed, pure=False)
    drawn = []
    for tile in todo:
        needed = [painted[other] for other in (tile, *grid.around(tile)) if other in painted]
        drawn.append(client.submit(do_job, draw_tile, canvas, tile, *needed, pure=False))
    return _follow([*painted.values(), *drawn], canvas, show)


def do_job(work: Callable[..., float | None], canvas: Canvas, tile: Tile, *before: object) -> float | None:
    """Paint or draw a tile on a worker, after freeing the memory used by earlier tiles."""
    gc.collect()
    give_memory_back()
    return work(canvas, tile, *before)


def _follow(futures: list[Future], canvas: Canvas, show: Callable[[int], None]) -> float:
    from distributed import as_completed  # noqa: PLC0415
    from distributed.comm.core import CommClosedError  # noqa: PLC0415
    from distributed.scheduler import KilledWorker  # noqa: PLC0415

    memory = [math.nan]
    again = f"type the same command to continue; finished tiles are kept in {canvas.path}"
    try:
        for done, future in enumerate(as_completed(futures), start=1):
            if future.status == "cancelled":
                raise UserError(f"the scheduler is gone, with {len(futures) - done + 1} jobs left; {again}")
            memory.append(future.result() or math.nan)  # re-raises the job's error
            show(done)
    except KilledWorker as error:
        raise UserError(
            f"a tile has killed {MOST_DEATHS} workers, perhaps for lack of memory; lower tile= and {again}"
        ) from error
    except (CommClosedError, TimeoutError) as error:
        raise UserError(f"the scheduler is gone; {again}") from error
    return float(np.nanmax(memory)) if any(map(math.isfinite, memory)) else math.nan
