"""Report, at the end of a run, where its files are, how to view or resume it, and one thing to try next."""

import logging
import shlex
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode

from brushexp.config.changes import shorten_words
from brushexp.config.vocabulary import meaning_of
from brushexp.config.words import parse_value
from brushexp.runs.run_folder import HYDRAS_FILES
from brushexp.system.run_files import CHECKPOINT, METRICS_FILE, files_written
from brushexp.system.terminal import as_shown
from brushexp.system.words import table_of_words

log = logging.getLogger(__name__)
EXPORTS = "to"  # key for exports of a finished painting
NAMED = 4  # maximum number of files in a message


def log_result(folder: Path, strokes: int, start: float | None) -> None:
    """Log where the painting and its page are, the number of ``strokes``, and a suggestion of what to try next.

    ``start`` is the value of `time.monotonic` when the program started. A job of a sweep logs only the painting and its
    strokes; a run started from Python logs nothing.
    """
    if not HydraConfig.initialized():
        return
    took = "" if start is None else f" in {time.monotonic() - start:.0f} s"
    count = f"{strokes:,} stroke{'s' * (strokes != 1)}"
    log.info("%s  %s%s", as_shown(folder / "painting.png"), count, took)
    if not is_job():
        log_page(folder, "shows how it was painted")
        log.info("next: %s", suggestion(list(HydraConfig.get().overrides.task), folder))


def is_job() -> bool:
    """Check whether this run is a job of a sweep."""
    return HydraConfig.initialized() and HydraConfig.get().mode is RunMode.MULTIRUN


def how_to_go_on(folder: Path, task: str) -> str:
    """Describe how to resume an interrupted run; if that is impossible, list its files and say how to start over."""
    place = as_shown(folder)
    if (folder / CHECKPOINT).is_file():
        return f"continue with: {shlex.join(['brushexp', *[f'task={task}'] * (task != 'paint'), f'resume={place}'])}"
    names = [path.relative_to(folder).as_posix() for path in files_written(folder)]
    whole = sorted((name for name in names if name not in HYDRAS_FILES), key=lambda name: "painting" not in name)
    more = f" and {len(whole) - NAMED} more" if len(whole) > NAMED else ""
    kept = f"{place} has {', '.join(whole[:NAMED])}{more}" if whole else "nothing is finished"
    words = [f"output={place}", *["overwrite=true"] * (METRICS_FILE in names)]
    return f"{kept}; to start over, repeat the command with: {shlex.join(words)}"


def log_page(folder: Path, what: str) -> None:
    """If a run or sweep has a page, log where it is and how to view it."""
    if (folder / "report.html").is_file():
        newest = folder.resolve().parent == Path("outputs").resolve()
        look = "".join(f"; {words}: {command}" for command, words in table_of_words("page").items())
        place = "" if newest or not look else f" {shlex.quote(as_shown(folder))}"
        log.info("%s  %s%s%s", as_shown(folder / "report.html"), what, look, place)


def suggestion(words: Sequence[str], folder: Path) -> str:
    """Suggest one thing to try after a painting made with these command-line arguments.

    Proposals come from the ``[next.WORD]`` tables of the vocabulary files: ``gives`` describes the result, ``after``
    limits the proposal to paintings made with one of the listed words, and ``unless`` lists keys that rule it out.

    >>> suggestion(["image=photo.jpg"], Path("outputs/x"))
    'only what matters, in fewer and larger strokes: brushexp photo.jpg abstract'
    >>> suggestion(["image=photo.jpg", "quality=draft"], Path("outputs/x"))
    'the same picture, finished: brushexp photo.jpg quality=normal'
    >>> suggestion(["image=photo.jpg", "strokes=300"], Path("outputs/x"))
    'another look: brushexp photo.jpg strokes=300 look=watercolour'
    >>> suggestion(["resume=outputs/x"], Path("outputs/x"))
    'large, for print: brushexp export outputs/x resolution=4096'
    >>> suggestion(['image="${x}, it.jpg"'], Path("outputs/x"))
    "only what matters, in fewer and larger strokes: brushexp '${x}, it.jpg' abstract"
    """
    words = shorten_words(words)
    proposals = table_of_words("next")
    first = sorted(proposals, key=lambda word: "after" not in proposals[word])
    for word in first:
        if _fits(word, proposals[word], words):
            return f"{proposals[word]['gives']}: {shlex.join(_command(word, words, folder))}"
    return f"large, for print: {shlex.join(_export(folder, 'resolution=4096'))}"


def _fits(word: str, proposal: Mapping[str, Any], words: Sequence[str]) -> bool:
    """Check whether a proposal makes sense after a painting made with these arguments."""
    typed = {_family(one) for one in words}
    if "after" in proposal:
        matches = any(one in words if "=" in one else one in typed for one in proposal["after"])
    else:
        matches = _family(word) not in typed
    return matches and not typed & {"resume", *proposal.get("unless", ())}


def _command(word: str, words: Sequence[str], folder: Path) -> list[str]:
    """Return the command for a proposal: export the painting, or paint it again with one more argument."""
    if _family(word) == EXPORTS:
        return _export(folder, word)
    dropped = {"output", "overwrite", _family(word)}
    typed = [_unquote(one).removeprefix("image=") for one in words if _family(one) not in dropped]
    return ["brushexp", *typed, word]


def _export(folder: Path, word: str) -> list[str]:
    return ["brushexp", "export", as_shown(folder), word]


def _family(word: str) -> str:
    """Return the first part of the key that an argument sets; the argument is ``key=value`` or a painter's word.

    >>> _family("palette.values=5"), _family("+metric=lpips"), _family("abstract")
    ('palette', 'metric', 'abstraction')
    """
    return (meaning_of(word) or word).lstrip("+~").partition("=")[0].partition(".")[0]


def _unquote(word: str) -> str:
    """Return an argument without the quotes that Hydra's grammar requires."""
    key, _, value = word.partition("=")
    return f"{key}={parse_value(value)}" if value.startswith('"') else word
