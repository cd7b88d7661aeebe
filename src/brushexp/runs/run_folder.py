"""Lock the folder of a run, protect finished runs, and remove files left by earlier runs."""

import logging
import os
import shutil
from collections.abc import Collection, Iterator, Sequence
from contextlib import suppress
from itertools import count
from pathlib import Path
from typing import Any

from hydra.experimental.callback import Callback
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from brushexp.config.check import check, leaves
from brushexp.config.compose import folders_in
from brushexp.config.mistakes import explanation
from brushexp.config.output_folders import BESIDE_PAINTING, BY_TIME
from brushexp.config.tasks import TASKS
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

HYDRAS_FILES = ("run.log", ".hydra/config.yaml", ".hydra/hydra.yaml", ".hydra/overrides.yaml")  # written before a task
N_JOBS = "hydra.launcher.n_jobs="  # with a launcher, the override that jobs= stands for
log = logging.getLogger(__name__)
_locks: list[Any] = []  # locks held until this process ends


class RunFolder(Callback):
    """A callback that claims the folder of a single run before Hydra writes into it; sweeps use `begin_sweep`."""

    def on_run_start(self, config: DictConfig, **_: Any) -> None:
        words: Any = OmegaConf.to_container(config.hydra.overrides.task, resolve=False)  # such as output=x/${seed}
        try:
            if config.hydra.sweeper.get("resume"):
                raise UserError("resume=sweep is for sweeps; repeat the whole command, including -m")
            check_place(config)
            check(config, words)
            warn_of_launcher(config)
            take_folder(take_name(config, Path(config.hydra.run.dir)), config)
        except (UserError, OmegaConfBaseException, OSError) as error:  # Hydra itself would only warn
            is_theirs = isinstance(error, OmegaConfBaseException | OSError)
            message = explanation(error, folders_in(config), words) if is_theirs else " ".join(str(error).split())
            raise SystemExit(f"brushexp: {message}") from error


def check_place(cfg: DictConfig) -> None:
    """Raise a UserError if Hydra would change the working folder, because paths in the settings are relative to it."""
    if cfg.hydra.job.chdir:
        raise UserError("hydra.job.chdir=true would break relative paths in the settings; drop it")


def warn_of_launcher(cfg: DictConfig) -> None:
    """Warn if a launcher was chosen, because it has no effect on a single run."""
    words = [word for word in cfg.hydra.overrides.hydra if word.startswith(("hydra/launcher=", N_JOBS))]
    if words:
        typed = words[-1].replace(N_JOBS, "jobs=")
        log.warning("%s has no effect on a single run; use it for several pictures or a sweep: -m seed=0,1", typed)


def take_name(cfg: DictConfig, folder: Path) -> Path:
    """Return the folder of a run or sweep; a default folder is created, with a number if its name is taken (``x_2``).

    The default name is the time of the run. Each job of a sweep would compute this time again, so it is fixed here.
    """
    plain: Any = OmegaConf.to_container(cfg, resolve=False)
    if plain["output"] not in (BY_TIME, BESIDE_PAINTING) or folder != Path(cfg.output):
        return folder
    folder.parent.mkdir(parents=True, exist_ok=True)
    for number in count(1):
        free = folder if number == 1 else folder.with_name(f"{folder.name}_{number}")
        with suppress(FileExistsError):
            free.mkdir()
            break
    moments = OmegaConf.get_cache(cfg)["now"]
    moments.update({key: free.name for key, moment in moments.items() if moment == folder.name})
    return free


def take_folder(folder: Path, cfg: DictConfig, goes_on: bool = False) -> None:
    """Lock a folder until this process ends, remove the files of an aborted or replaced run, and record new files.

    Raises a UserError if another run is using the folder. Also raises a UserError if the folder holds a run that is
    finished or can be resumed, unless the new run continues that run (``goes_on``, ``resume``, or a task that
    ``grows``) or replaces it (``overwrite``).
    """
    lock(folder)
    source = cfg.get("resume")
    if source is not None and Path(source).resolve() != folder.resolve():
        with suppress(UserError):  # another run may be at work there, or the folder is read-only
            check_free(Path(source))
    goes_on = goes_on or (source is not None and Path(source).resolve() == folder.resolve())
    if not goes_on and "trainer" in cfg:  # fits write results with standard names
        check_inputs(folder, cfg)
    if not goes_on and not TASKS[cfg.task].grows(cfg, folder):
        if not cfg.overwrite:
            _check_replaceable(folder)
        clear(folder, cfg)
    record_files(folder)


def _check_replaceable(folder: Path) -> None:
    """Raise a UserError if a folder holds a run or job that has ended or can be resumed."""
    own = [folder / name for name in (CHECKPOINT, METRICS_FILE) if (folder / name).is_file()]
    jobs = [path for path in files_written(folder) if path.name in (CHECKPOINT, METRICS_FILE)]
    if not (results := [*own, *jobs]):
        return
    cure = f"continue it with resume={folder}, or " if results[0] == folder / CHECKPOINT else ""
    if (folder / "multirun.yaml").is_file():
        cure = "repeat the command with resume=sweep to continue the sweep, or "
    raise UserError(
        f"output={folder} already holds a run ({results[0].relative_to(folder)}); {cure}choose another folder, "
        "or replace the run with overwrite=true"
    )


def take_job(folder: Path, cfg: DictConfig, sweep: Path) -> None:
    """Claim the folder of a job in the process that runs the job.

    A job that was killed resumes from its checkpoint (``cfg.resume`` is set) or starts over.
    """
    if "resume" in cfg and (folder / CHECKPOINT).is_file():
        cfg.resume = str(folder)
    elif not TASKS[cfg.task].grows(cfg, folder):
        clear(folder, cfg, HYDRAS_FILES)
    record_files(sweep)  # every process rewrites its report
    record_files(folder)
    note_files(folder, [folder / name for name in HYDRAS_FILES])
    note_files(sweep, [folder / MANIFEST])


def check_inputs(folder: Path, cfg: DictConfig) -> None:
    """Raise a UserError if results of the run would overwrite one of its inputs in this folder."""
    for key, value, path in _inputs(cfg):
        is_result = path.stem in TASKS[cfg.task].results or (path.suffix == ".safetensors" and cfg.task != "paint")
        if is_result and path.parent == folder.resolve() and path.is_file():
            raise UserError(f"a run in output={folder} would replace {key}={value}; choose another folder")


def _inputs(cfg: DictConfig) -> Iterator[tuple[str, str, Path]]:
    """Yield the key, value and absolute path of each setting that may name an input, and of each picture of a sweep."""
    for key, value in leaves(OmegaConf.to_container(cfg)):
        is_picture = key.startswith("hydra.sweeper.pictures.")
        is_other = key.startswith(("hydra.", "output")) and not is_picture
        if not isinstance(value, str) or is_other:
            continue
        if is_picture or "." in value or key.partition(".")[0] in ("catalogue", "data", "runs"):
            for path in pictures_in(value) if is_picture and is_several(value) else [value]:
                yield key.removeprefix("hydra.sweeper."), value, Path(os.path.expanduser(path)).resolve()


def note_words(folder: Path, cfg: DictConfig, words: Sequence[str]) -> None:
    """Write the config and the overrides of a run into its folder, as Hydra does."""
    (folder / ".hydra").mkdir(parents=True, exist_ok=True)
    write_text(folder / ".hydra" / "config.yaml", OmegaConf.to_yaml(cfg))
    write_text(folder / ".hydra" / "overrides.yaml", OmegaConf.to_yaml(OmegaConf.create([*words])))


def release_folder(folder: Path) -> None:
    """Unlock a folder before this process ends."""
    stop_recording(folder)
    for held in [lock for lock in _locks if Path(lock.lock_file).parents[1] == folder]:
        held.release()
        _locks.remove(held)


def lock(folder: Path) -> None:
    """Lock a folder until this process ends, or raise a UserError; remove partial files left by killed processes."""
    from filelock import FileLock, Timeout  # noqa: PLC0415

    try:
        (folder / ".hydra").mkdir(parents=True, exist_ok=True)
        _locks.append(FileLock(folder / ".hydra" / "lock", timeout=0, is_singleton=True))
        _locks[-1].acquire()
    except Timeout:
        raise UserError(f"another run is at work in output={folder}; wait for it, or choose another folder") from None
    except OSError as error:
        raise UserError(f"cannot write into output={folder}: {error.strerror}; choose another folder") from error
    remove_half_written(folder)


def remove_half_written(folder: Path) -> None:
    """Remove partial files left by killed processes from a locked folder and from the run folders in it."""
    places = {folder, *(path for path in folder.glob("*") if path.is_dir())}
    places |= {path.parent for path in files_written(folder)}
    for path in [path for place in places for path in place.glob(TEMPORARY)]:
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink(missing_ok=True)


def check_free(folder: Path) -> None:
    """Raise a UserError if another process is working in a folder."""
    lock(folder)
    _locks.pop().release()


def clear(folder: Path, cfg: DictConfig, besides: Collection[str] = ()) -> None:
    """Remove the files that runs wrote into a folder, except those in ``besides``; also remove subfolders left empty.

    Raises a UserError if the current run needs one of these files.
    """
    spared = [folder / name for name in besides]
    files = [path for path in dict.fromkeys(files_written(folder)) if path not in spared]
    folders = {folder / part for path in files for part in path.relative_to(folder).parents}
    replaced = {path.resolve() for path in (*files, *folders)}
    for key, value, path in _inputs(cfg):
        if path in replaced:
            raise UserError(f"a run in output={folder} would replace {key}={value}; choose another folder")
    for path in files:
        path.unlink()  # removes a link, not the file to which it points
    for path in sorted(folders - {folder}, reverse=True):
        if not path.is_symlink() and not any(path.iterdir()):
            path.rmdir()
    (folder / MANIFEST).unlink(missing_ok=True)
