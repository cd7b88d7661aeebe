"""The folder of a run: one run in it at a time, and none over what another has left there."""

import os
import re
from collections.abc import Collection, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.experimental.callback import Callback
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from brushexp.config.check import check, leaves
from brushexp.errors import UserError
from brushexp.pictures.folders import is_several, pictures_in
from brushexp.registry import plugins
from brushexp.results.runs import JOBS
from brushexp.system.files import TEMPORARY, write_text
from brushexp.system.reading import json_of, read_text

OURS = re.compile(  # files that tasks write into their folders
    "(metrics|result|run|report|checkpoint|multirun|painting|target|focus|style|timelapse|catalogue|strokes|process|relief"
    "|height|normals|validation|outside|pruning|extremes|brushwork|brushwork_against|summary|table|sheet|effect|curves"
    "|pareto|anytime|leaderboard|film|preview|flat|differences|distances|ablations|optimization_results)"
    "[.](png|svg|mp4|gif|h5|json|csv|md|tex|html|log|yaml|ckpt|pdf|(hpgl|gcode)([.](svg|txt))?)"
)
BELOW = (  # and below them
    *(
        ".hydra/*.yaml",
        "curves/metrics.csv",
        "pictures/epoch_*.png",
        "strokes/[0-9]*.h5",
        "frames/[0-9]*.h5",
        "checkpoints/*.ckpt",
    ),
    *("tensorboard/*tfevents*", "tensorboard/hparams.yaml"),
    *("ratio_*/*.png", "ratio_*/*/epoch_*.png", "ratio_*/*/*.csv"),
    *("added/*/*.png", "added/*/result.json"),
)
OF_THIS_RUN = ("run.log", "config.yaml", "hydra.yaml", "overrides.yaml")  # that Hydra has begun before the task does
WORTH = ("checkpoint.ckpt", "metrics.json", "result.json")  # with one of them a run can go on, or has a result
SUBFOLDER = "hydra.sweep.subdir="  # of the sweep's folder, where a job is
OTHERS = ".hydra/others.txt"  # names of files that look like ours and were there before the first run
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
    """Keep other processes away from a folder until this one ends, and remove what a run has left that came to nothing.

    A UserError if another run is at work there, or the folder holds one that has finished or can go on, and this one
    neither ``goes_on`` with it (as with the key ``resume``; a set of strokes goes on by itself) nor replaces it
    (``overwrite``).
    """
    is_new = is_unused(folder)
    lock(folder)
    if is_new:
        note_others(folder)  # first: a refusal, too, leaves the folder to the next run
    resumed = cfg.get("resume")
    goes_on = goes_on or (resumed is not None and Path(resumed).resolve() == folder.resolve())
    if not goes_on and "trainer" in cfg:  # it fits something to what it reads
        check_inputs(folder, cfg)
    if is_new or goes_on or grows(folder, cfg):
        return
    worth = next((path for path in left_in(folder) if path.name in WORTH), None)
    if worth and not cfg.overwrite:
        can_go_on = f"continue it with resume={folder}, or " if worth == folder / "checkpoint.ckpt" else ""
        if (folder / "multirun.yaml").is_file():
            can_go_on = "type the same and resume=sweep to continue a sweep, or "
        raise UserError(
            f"output={folder} holds a run already ({worth.relative_to(folder)}); {can_go_on}choose another folder, "
            "or replace the run with overwrite=true"
        )
    clear(folder, cfg)


def take_job(folder: Path, cfg: DictConfig) -> None:
    """Do what `take` does, for a job of a sweep, in the process that runs it.

    A job that was here before, killed or sent away by a cluster, goes on from its checkpoint (``cfg.resume`` is set) or
    starts anew: one that has finished is never sent here again.
    """
    is_new = not (folder / OTHERS).exists()  # its settings are written before this
    lock(folder)
    if is_new:
        note_others(folder)
    elif "resume" in cfg and (folder / "checkpoint.ckpt").is_file():
        cfg.resume = str(folder)
    elif not grows(folder, cfg):
        clear(folder, cfg, OF_THIS_RUN)


def is_unused(folder: Path) -> bool:
    """Whether no run has been in a folder: none has noted what was there before, or left its settings."""
    return not any((folder / name).is_file() for name in (OTHERS, ".hydra/config.yaml", JOBS, "multirun.yaml"))


def check_inputs(folder: Path, cfg: DictConfig) -> None:
    """Refuse (UserError) to begin with a file of this folder that has the name of one of a run's own."""
    there = folder.resolve()
    for key, value, path in files_read(cfg):
        if path.parent == there and is_ours(path.name) and path.is_file():
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


def note_others(folder: Path) -> None:
    """Remember which files were there before the first run, though their names are like ours."""
    names = [path.name for path in left_in(folder) if path.name not in OF_THIS_RUN]
    (folder / OTHERS).write_text("\n".join(names), encoding="utf-8")


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
    mine = [lock for lock in _held if Path(lock.lock_file).parents[1] == folder]
    for found in mine:
        found.release()
        _held.remove(found)


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


def named_jobs(folder: Path) -> set[str]:
    """The folders of the jobs of a sweep that have other names than their numbers."""
    with suppress(UserError, ValueError, KeyError, TypeError):  # of a file that is damaged: none
        jobs = json_of(read_text(folder / JOBS, ""))["jobs"]
        return {place_of(word) for job in jobs for word in job if word.startswith(SUBFOLDER)}
    return set()


def place_of(word: str) -> str:
    """The folder of a job, by the word that names it."""
    return str(OverridesParser.create().parse_override(word).value())


def is_ours(name: str) -> bool:
    """Whether a file has the name of one that a task writes into its folder."""
    weights = "|".join(["discriminator", *(plugin.name for plugin in plugins("renderer"))])
    return bool(OURS.fullmatch(name) or re.fullmatch(rf"({weights})(_[0-9.]+)?[.](safetensors|json)", name))


def left_in(folder: Path) -> Iterator[Path]:
    """Files that runs have left in a folder, and in those of the jobs of a sweep; nothing that a run does not write."""
    is_sweep = (folder / "multirun.yaml").is_file() or (folder / JOBS).is_file()
    others = read_text(folder / OTHERS, "remove it").split("\n") if (folder / OTHERS).exists() else []
    jobs = named_jobs(folder)
    for path in sorted(folder.iterdir()):
        is_job = path.name.isdecimal() or path.name in jobs or (path / "result.json").is_file()
        if is_ours(path.name):
            if path.name not in others:
                yield path
        elif is_sweep and is_job and (path / ".hydra").is_dir():
            yield from left_in(path)
    for pattern in BELOW:
        yield from folder.glob(pattern)


def clear(folder: Path, cfg: DictConfig, besides: Collection[str] = ()) -> None:
    """Remove what runs have left in a folder, ``besides`` these; refuse (UserError) if this one reads some of it."""
    files = [path for path in left_in(folder) if path.name not in besides]
    folders = {folder / part for path in files for part in path.relative_to(folder).parents}
    taken = {path.resolve() for path in (*files, *folders)}
    for key, value, path in files_read(cfg):
        if path in taken:
            raise UserError(f"a run in output={folder} would replace {key}={value}; choose another folder")
    for path in files:
        path.unlink()  # of a link to a file elsewhere, the link
    for path in sorted(folders - {folder}, reverse=True):
        if not path.is_symlink() and not any(path.iterdir()):
            path.rmdir()
