"""Locks the folder of a run, refuses to replace a finished run, and removes what earlier runs have written there."""

import os
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import Any

from hydra.experimental.callback import Callback
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from brushexp.config.check import check, leaves
from brushexp.errors import UserError
from brushexp.pictures.folders import is_several, pictures_in
from brushexp.system.files import TEMPORARY, write_text
from brushexp.system.run_files import (
    CHECKPOINT,
    MANIFEST,
    METRICS_FILE,
    files_written,
    note_files,
    record_files,
    stop_recording,
)

HYDRAS_FILES = ("run.log", ".hydra/config.yaml", ".hydra/hydra.yaml", ".hydra/overrides.yaml")  # begun before the task
RESULTS = (
    "painting",
    "target",
    "flat",
    "style",
    "focus",
    "timelapse",
    "film",
    "preview",
    "catalogue",
    "strokes",
)  # stems
WEIGHTS = ".safetensors"  # ending of the weights that a training writes
_held: list[Any] = []  # locks, until this process ends


class RunFolder(Callback):
    """Hydra callback that takes a folder before anything is written into it; `begin_sweep` does it for a sweep."""

    def on_run_start(self, config: DictConfig, **_: Any) -> None:
        try:
            if config.hydra.sweeper.get("resume"):
                raise UserError("resume=sweep is for a sweep; type all that it was begun with, also -m")
            check(config, list(config.hydra.overrides.task))
            take(Path(config.hydra.run.dir), config)
        except (UserError, OmegaConfBaseException, OSError) as error:  # of which Hydra would make warnings
            raise SystemExit(f"brushexp: {' '.join(str(error).split())}") from error


def take(folder: Path, cfg: DictConfig, goes_on: bool = False) -> None:
    """Keep other processes away from a folder until this one ends, and remove what an aborted run has written there.

    A UserError if another run is at work there, or the folder holds one that has finished or can go on, and this one
    neither ``goes_on`` with it (as with the key ``resume``; a set of strokes goes on by itself) nor replaces it
    (``overwrite``). What this process writes into the folder is noted from now on.
    """
    lock(folder)
    resumed = cfg.get("resume")
    goes_on = goes_on or (resumed is not None and Path(resumed).resolve() == folder.resolve())
    if not goes_on and "trainer" in cfg:  # it fits something to what it reads
        check_inputs(folder, cfg)
    if not goes_on and not grows(folder, cfg):
        if not cfg.overwrite:
            check_replaceable(folder)
        clear(folder, cfg)
    record_files(folder)


def check_replaceable(folder: Path) -> None:
    """Refuse (UserError) a folder with a run, or a job of a sweep, that has finished or can go on."""
    own = [folder / name for name in (CHECKPOINT, METRICS_FILE) if (folder / name).is_file()]
    jobs = [path for path in files_written(folder) if path.name in (CHECKPOINT, METRICS_FILE)]
    if not (kept := [*own, *jobs]):
        return
    can_go_on = f"continue it with resume={folder}, or " if kept[0] == folder / CHECKPOINT else ""
    if (folder / "multirun.yaml").is_file():
        can_go_on = "type the same and resume=sweep to continue a sweep, or "
    raise UserError(
        f"output={folder} holds a run already ({kept[0].relative_to(folder)}); {can_go_on}choose another folder, "
        "or replace the run with overwrite=true"
    )


def take_job(folder: Path, cfg: DictConfig, sweep: Path) -> None:
    """Do what `take` does, for a job of a sweep, in the process that runs it and has locked the folder.

    A job that was here before, killed or sent away by a cluster, goes on from its checkpoint (``cfg.resume`` is set) or
    starts anew: one that has finished is never sent here again.
    """
    if "resume" in cfg and (folder / CHECKPOINT).is_file():
        cfg.resume = str(folder)
    elif not grows(folder, cfg):
        clear(folder, cfg, HYDRAS_FILES)
    record_files(sweep)  # its report is renewed by every process
    record_files(folder)
    note_files(folder, [folder / name for name in HYDRAS_FILES])
    note_files(sweep, [folder / MANIFEST])


def check_inputs(folder: Path, cfg: DictConfig) -> None:
    """Refuse (UserError) to begin with a file of this folder that has the name of a result of the run."""
    root = folder.resolve()
    for key, value, path in files_read(cfg):
        is_result = path.stem in RESULTS or (path.suffix == WEIGHTS and cfg.task != "paint")
        if is_result and path.parent == root and path.is_file():
            raise UserError(f"a run in output={folder} would replace {key}={value}; choose another folder")


def files_read(cfg: DictConfig) -> Iterator[tuple[str, str, Path]]:
    """Key, value and whole path of what may be files and folders that a run reads, and of each picture of a sweep."""
    for key, value in leaves(OmegaConf.to_container(cfg)):
        is_picture = key.startswith("hydra.sweeper.pictures.")
        is_other = key.startswith(("hydra.", "output")) and not is_picture
        if not isinstance(value, str) or is_other:
            continue
        if is_picture or "." in value or key.partition(".")[0] in ("catalogue", "data", "runs"):
            for path in pictures_in(value) if is_picture and is_several(value) else [value]:
                yield key.removeprefix("hydra.sweeper."), value, Path(os.path.expanduser(path)).resolve()


def grows(folder: Path, cfg: DictConfig) -> bool:
    """Whether a folder holds a set of strokes to which this run adds."""
    return cfg.task == "simulate" and cfg.path is None and (folder / "strokes").is_dir()


def note_words(folder: Path, cfg: DictConfig, words: Sequence[str]) -> None:
    """Leave config and overrides of a run in its folder, as Hydra does."""
    (folder / ".hydra").mkdir(parents=True, exist_ok=True)
    write_text(folder / ".hydra" / "config.yaml", OmegaConf.to_yaml(cfg))
    write_text(folder / ".hydra" / "overrides.yaml", OmegaConf.to_yaml(OmegaConf.create([*words])))


def release(folder: Path) -> None:
    """Let others into a folder before this process ends."""
    stop_recording(folder)
    mine = [lock for lock in _held if Path(lock.lock_file).parents[1] == folder]
    for held in mine:
        held.release()
        _held.remove(held)


def lock(folder: Path) -> None:
    """Keep other processes out of a folder until this one ends, or is killed; UserError if one is there.

    Files that a killed one was writing are removed.
    """
    from filelock import FileLock, Timeout  # noqa: PLC0415

    try:
        (folder / ".hydra").mkdir(parents=True, exist_ok=True)
        _held.append(FileLock(folder / ".hydra" / "lock", timeout=0, is_singleton=True))
        _held[-1].acquire()
    except Timeout:
        raise UserError(f"another run is at work in output={folder}; wait for its end, or choose another one") from None
    except OSError as error:
        raise UserError(f"cannot write into output={folder}: {error.strerror}; choose another folder") from error
    for path in [*folder.glob(TEMPORARY), *folder.glob(f"*/{TEMPORARY}")]:
        path.unlink(missing_ok=True)


def check_free(folder: Path) -> None:
    """Refuse (UserError) a folder in which another process is at work."""
    lock(folder)
    _held.pop().release()


def clear(folder: Path, cfg: DictConfig, besides: Collection[str] = ()) -> None:
    """Remove what runs have written into a folder, ``besides`` these; refuse (UserError) if this one reads some of it.

    Folders that are empty then go, too.
    """
    kept = [folder / name for name in besides]
    files = [path for path in files_written(folder) if path not in kept]
    folders = {folder / part for path in files for part in path.relative_to(folder).parents}
    replaced = {path.resolve() for path in (*files, *folders)}
    for key, value, path in files_read(cfg):
        if path in replaced:
            raise UserError(f"a run in output={folder} would replace {key}={value}; choose another folder")
    for path in files:
        path.unlink()  # of a link to a file elsewhere, the link
    for path in sorted(folders - {folder}, reverse=True):
        if not path.is_symlink() and not any(path.iterdir()):
            path.rmdir()
    (folder / MANIFEST).unlink(missing_ok=True)
