"""Say at the end of a run where it is, how to look at it or to go on with it, and one thing to try next."""

import logging
import shlex
import time
from collections.abc import Sequence
from pathlib import Path

from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode

from brushexp.config.changes import shortened
from brushexp.config.words import parse_value
from brushexp.runs.run_folder import HYDRAS_FILES
from brushexp.system.run_files import CHECKPOINT, METRICS_FILE, files_written
from brushexp.system.terminal import as_shown
from brushexp.system.words import table_of_words

log = logging.getLogger(__name__)
MANY_STROKES = 600  # strokes, from which 300 are few
NAMED = 4  # files that a line names


def say_where(folder: Path, strokes: int, start: float | None) -> None:
    """Name the painting of ``strokes`` and its page; ``start`` is `time.monotonic` at the start of the program.

    A job of a sweep says the first in a line; from Python nothing is said.
    """
    if not HydraConfig.initialized():
        return
    took = "" if start is None else f" in {time.monotonic() - start:.0f} s"
    log.info("%s  %s strokes%s", as_shown(folder / "painting.png"), f"{strokes:,}", took)
    if not is_job():
        say_page(folder, "how it was painted")
        log.info("next: %s", suggestion(list(HydraConfig.get().overrides.task), folder, strokes))


def is_job() -> bool:
    """Whether this run is a job of a sweep."""
    return HydraConfig.initialized() and HydraConfig.get().mode is RunMode.MULTIRUN


def how_to_go_on(folder: Path, task: str) -> str:
    """Say what an interrupted run has finished, and what to type to go on with it or to begin it anew."""
    place = as_shown(folder)
    if (folder / CHECKPOINT).is_file():
        return f"continue with: {shlex.join(['brushexp', *[f'task={task}'] * (task != 'paint'), f'resume={place}'])}"
    names = [path.relative_to(folder).as_posix() for path in files_written(folder)]
    whole = sorted((name for name in names if name not in HYDRAS_FILES), key=lambda name: "painting" not in name)
    more = f" and {len(whole) - NAMED} more" if len(whole) > NAMED else ""
    kept = f"{place} has {', '.join(whole[:NAMED])}{more}" if whole else "nothing is finished"
    words = [f"output={place}", *["overwrite=true"] * (METRICS_FILE in names)]
    return f"{kept}; to begin anew, type the same and: {shlex.join(words)}"


def say_page(folder: Path, what: str) -> None:
    """Name the page of a run or sweep, if there is one, and how to look at it."""
    if (folder / "report.html").is_file():
        newest = folder.resolve().parent == Path("outputs").resolve()
        look = "".join(f"; {words}: {command}" for command, words in table_of_words("page").items())
        place = "" if newest or not look else f" {shlex.quote(as_shown(folder))}"
        log.info("%s  %s%s%s", as_shown(folder / "report.html"), what, look, place)


def suggestion(words: Sequence[str], folder: Path, strokes: int = 4000) -> str:
    """Choose one thing to try after a painting of so many strokes, by these words of a command line.

    >>> suggestion(["image=photo.jpg"], Path("outputs/x"))
    'fewer and larger strokes: brushexp photo.jpg strokes=300'
    >>> suggestion(["image=photo.jpg", "strokes=300"], Path("outputs/x"))
    'another look: brushexp photo.jpg strokes=300 look=watercolour'
    >>> suggestion(["image=photo.jpg"], Path("outputs/x"), strokes=80)
    'another look: brushexp photo.jpg look=watercolour'
    >>> suggestion(["look=ink", "strokes=300"], Path("outputs/x"))
    'large, for print: brushexp export outputs/x resolution=4096'
    >>> suggestion(['image="${x}, it.jpg"'], Path("outputs/x"))
    "fewer and larger strokes: brushexp '${x}, it.jpg' strokes=300"
    """
    keys = {word.partition("=")[0] for word in words}
    others = [word for word in shortened(words) if not word.startswith(("output=", "overwrite=", "resume="))]
    typed = [_unquoted(word).removeprefix("image=") for word in others]
    for word, what in table_of_words("next").items():
        key = word.partition("=")[0]
        if not keys & {key, "detail", "resume"} and not (key == "strokes" and strokes < MANY_STROKES):
            return f"{what}: {shlex.join(['brushexp', *typed, word])}"
    return f"large, for print: {shlex.join(['brushexp', 'export', as_shown(folder), 'resolution=4096'])}"


def _unquoted(word: str) -> str:
    """Write a word as it was typed before it was put in the quotes of Hydra's grammar."""
    key, _, value = word.partition("=")
    return f"{key}={parse_value(value)}" if value.startswith('"') else word
