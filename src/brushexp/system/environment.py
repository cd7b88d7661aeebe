"""Describe the software and hardware of a run without recording any paths."""

import hashlib
import os
import platform
import subprocess
import sys
from collections.abc import Mapping
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from brushexp import __version__

LONGEST_GIT = 5.0  # seconds after which a call of git is abandoned
PACKAGE = Path(__file__).parents[1]  # folder of brushexp's code
LIBRARIES = ("torch", "numba")  # libraries whose versions may change the bits of a painting
QUIET = {"GIT_OPTIONAL_LOCKS": "0", "LC_ALL": "C"}


def versions() -> dict[str, str | None]:
    """Return the versions of Python and the numerical libraries; None for a library that is not installed."""
    return {"python": platform.python_version(), **{name: _version(name) for name in LIBRARIES}}


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None


@cache
def processor() -> str:
    """Return the processor's name, such as "Intel(R) Xeon(R) Processor", or its architecture if that is unknown."""
    if sys.platform == "linux":
        try:
            lines = Path("/proc/cpuinfo").read_text(errors="replace").splitlines()
        except OSError:  # the file may be hidden
            lines = []
        names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
        return next(names, "") or platform.machine()
    if sys.platform == "darwin":
        return _output("sysctl", "-n", "machdep.cpu.brand_string") or platform.machine()
    return platform.processor() or platform.machine()


@cache
def code_state() -> dict[str, Any]:
    """Return the ``version`` of this installation of brushexp and, if it is a checkout, its `git_state`."""
    is_tracked = bool(_git(PACKAGE, "ls-files", "__init__.py"))  # not inside an unrelated repository
    return {"version": __version__, **((git_state(PACKAGE) or {}) if is_tracked else {})}


def project_state(folder: Path) -> dict[str, Any] | None:
    """Return the `git_state` of a folder's repository; None if there is none or it is brushexp's own repository."""
    top = _git(folder, "rev-parse", "--show-toplevel")
    if top is None or ("commit" in code_state() and top == _git(PACKAGE, "rev-parse", "--show-toplevel")):
        return None
    return git_state(folder)


def git_state(folder: Path) -> dict[str, Any] | None:
    """Return the ``commit`` of a checkout, whether it is ``dirty``, and its ``changes``; None without a repository.

    A checkout is dirty if a tracked file differs from the commit; ``changes`` is then the SHA-256 of ``git diff HEAD``,
    which distinguishes states of the same commit. Untracked files do not count. If git takes too long, ``dirty`` is
    None.
    """
    commit = _git(folder, "rev-parse", "HEAD")
    if commit is None:
        return None
    difference = _git(folder, "diff", "HEAD", "--no-ext-diff", "--no-textconv", "--no-color")
    if difference is None:  # git took too long
        return {"commit": commit, "dirty": None, "changes": None}
    changes = hashlib.sha256(difference.encode(errors="surrogateescape")).hexdigest() if difference else None
    return {"commit": commit, "dirty": bool(difference), "changes": changes}


def _git(folder: Path, *words: str) -> str | None:
    """Run git in a folder and return its output, or None if git fails, is not installed or takes too long.

    Git runs without the repository's file system monitor and without inherited ``GIT_*`` environment variables.
    """
    others = {key: value for key, value in os.environ.items() if not key.startswith("GIT_")}
    return _output("git", "-C", str(folder), "-c", "core.fsmonitor=false", *words, environment=others | QUIET)


def _output(*words: str, environment: Mapping[str, str] | None = None) -> str | None:
    """Run a program and return its output, or None if it fails."""
    try:
        done = subprocess.run(words, capture_output=True, check=True, timeout=LONGEST_GIT, env=environment)
        return done.stdout.decode(errors="surrogateescape").strip()
    except (OSError, subprocess.SubprocessError):
        return None
