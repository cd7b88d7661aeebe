"""Compose and check settings given in Python just as the command line does, with the same error messages."""

import logging
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from pathlib import Path
from typing import Any, get_origin

from hydra.errors import CompactHydraException
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from brushexp.config.changes import expand_changes
from brushexp.config.check import check, check_stand_ins
from brushexp.config.compose import compose_config, folders_of
from brushexp.config.key_types import type_of_key
from brushexp.config.mistakes import explanation
from brushexp.config.publish import prepare
from brushexp.config.vocabulary import spell_paths
from brushexp.config.words import as_typed, expand_shorthand, parse_value
from brushexp.errors import UserError
from brushexp.pictures.held import HeldPicture, hold, is_picture
from brushexp.registry import drop_built
from brushexp.system.runtime import use_threads
from brushexp.system.spellings import find_path
from brushexp.system.words import table_of_words

PICTURE = "image="
_composed = lru_cache(maxsize=32)(compose_config)  # Hydra takes a while to compose
RESERVED = {"task": "call another function", "output": "set output=", "resume": "type brushexp resume=... in a shell"}


@cache
def load_choices() -> list[Path]:
    """Load all plugins, including those in the current folder, on the first call; return the config folders."""
    prepare(Path())
    return folders_of(Path().resolve())  # the program may change its working folder


@dataclass(frozen=True)
class Settings:
    """A task's checked config, with its overrides and the in-memory pictures that it refers to."""

    cfg: DictConfig
    words: list[str]
    held: dict[str, HeldPicture]  # by key
    folder: Path | None  # folder of the run; None if nothing is written

    def __getstate__(self) -> dict[str, Any]:
        plain = OmegaConf.to_container(self.cfg, resolve=True)  # its types exist only where the plugins are loaded
        return {**vars(self), "cfg": OmegaConf.create(plain)}

    @property
    def yaml(self) -> str:
        return OmegaConf.to_yaml(self.cfg, resolve=True)

    @contextmanager
    def as_asked(self) -> Iterator[None]:
        """Within the ``with`` block, use the config's number of threads and isolate PyTorch as `undisturbed` does."""
        import torch  # noqa: PLC0415
        from lightning.pytorch.utilities.seed import isolate_rng  # noqa: PLC0415

        remarks, threads = logging.getLogger("lightning.pytorch"), torch.get_num_threads()
        level = remarks.level
        remarks.setLevel(max(level, logging.WARNING))  # otherwise it reports its hardware
        use_threads(self.cfg.threads or threads)
        try:
            with isolate_rng(), undisturbed():
                yield
        finally:
            remarks.setLevel(level)
            torch.set_num_threads(threads)


@contextmanager
def undisturbed(gradients: bool = True) -> Iterator[None]:
    """Within the ``with`` block, use PyTorch's default precision and device; restore the caller's afterwards.

    Gradients are enabled unless ``gradients`` is False.
    """
    import torch  # noqa: PLC0415

    dtype, gradients = torch.get_default_dtype(), gradients or torch.is_grad_enabled()
    place = nullcontext() if torch.get_default_device().type == "cpu" else torch.device("cpu")
    torch.set_default_dtype(torch.float32)
    try:
        with torch.inference_mode(False), torch.set_grad_enabled(gradients), place:
            yield
    finally:
        torch.set_default_dtype(dtype)


def settings_of(task: str, options: Mapping[str, Any], output: str | os.PathLike[str] | None = None) -> Settings:
    """Check a task's settings, given as Python values; raise a UserError where the command line would.

    Values may be numbers, strings, paths, None, lists and mappings of these, or in-memory pictures.
    """
    folders = load_choices()
    held: dict[str, HeldPicture] = {}
    folder = None if output is None else find_path(output).resolve()
    words = [f"task={task}", *words_from(options, held), *([] if folder is None else [f"output={folder}"])]
    words = [expand_shorthand(word, task=task) for word in expand_changes([spell_paths(word) for word in words])]
    check_stand_ins(task, dict(word.split("=", 1) for word in words))
    try:
        cfg = _composed(tuple(word for word in words if not word.startswith(PICTURE)), tuple(folders)).copy()
        for word in words:
            if word.startswith(PICTURE):
                cfg.image = parse_value(word.removeprefix(PICTURE))
    except (CompactHydraException, OmegaConfBaseException) as error:
        raise UserError(explanation(error, folders, words)) from error
    drop_built()  # nobody has painted with these settings
    check(cfg, words)
    return Settings(cfg, words, held, folder)


def write_pictures(settings: Settings, folder: Path) -> Settings:
    """Write in-memory pictures to the folder of a run, and put the paths of these files into the settings."""
    cfg, words = settings.cfg.copy(), settings.words
    for key, held in settings.held.items():
        path = str(held.write(folder / ".hydra", key.replace(".", "_")))
        OmegaConf.update(cfg, key, path)
        words = [
            expand_shorthand(f"{key}={path}", task=str(cfg.task)) if word.partition("=")[0] == key else word
            for word in words
        ]
    return replace(settings, cfg=cfg, words=words)


def words_from(options: Mapping[str, Any], held: dict[str, HeldPicture], above: str = "") -> Iterator[str]:
    """Yield each option as ``key=value``; mappings such as ``light={"azimuth": 90}`` are flattened to dotted keys."""
    for key, value in options.items():
        name = f"{above}{key}"
        if name in RESERVED:
            raise UserError(f"{name}={value} does not work in Python; {RESERVED[name]}")
        if isinstance(value, list | tuple) and (name == "image" or any(map(is_picture, value))):
            each = all(is_picture(one) or isinstance(one, str | os.PathLike) for one in value)
            cure = "give one after the other: for image in pictures" if name == "image" else "give one of them"
            cure = cure if each else f"for an array of numbers, give np.array({name})"
            raise UserError(f"{name} takes one picture, and this is a list of {len(value)}; {cure}")
        if is_picture(value):
            full = {"style": "style.image", **table_of_words("change_words")}.get(name, name)
            held[full] = hold(value, name)
            value = held[full].name  # noqa: PLW2901
        if isinstance(value, Mapping) and get_origin(type_of_key(name)[0]) is not dict:
            if not value:
                raise UserError(f"{name}={{}} is empty; leave it out, or give a value")
            yield from words_from(value, held, f"{name}.")
        else:
            yield f"{name}={as_typed(value)}"
