"""``brushexp doctor``: describe this installation in fifteen lines to paste into a bug report.

Libraries and plugins are imported in separate processes, so that a failure or crash does not end the report. If a check
fails, its line states the reason. A line that starts with "!" reports a broken part.
"""

import json
import os
import platform
import subprocess
import sys
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from importlib.metadata import PackageNotFoundError, distribution, entry_points, version
from pathlib import Path
from typing import Any

from brushexp import __version__
from brushexp.system.caches import can_hold, home_folder
from brushexp.system.environment import PACKAGE, code_state, processor

COLUMN = 12  # column at which descriptions start
PATIENCE = 300  # seconds after which an import counts as failed
FOR_DEVELOPERS = ("test", "docs", "dev")  # extras that users do not need
VARIABLES = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS", "CUDA_VISIBLE_DEVICES", "NUMBA_DISABLE_JIT")

# Each probe runs in its own process and ends with a line of JSON.
TORCH = """
import json, torch
gpu = torch.cuda.get_device_name() if torch.cuda.is_available() else None
print(json.dumps({"version": torch.__version__, "gpu": gpu, "cuda": torch.version.cuda or torch.version.hip}))
"""
NUMBA = """
import json, numba
from numba.core.caching import FunctionCache
from brushexp.compat.compiled import first_of
try:
    folder = FunctionCache(first_of).cache_path
except RuntimeError:
    folder = None
print(json.dumps({"version": numba.__version__, "folder": folder}))
"""
PLUGINS = """
import json
from pathlib import Path
from brushexp.errors import UserError
from brushexp.registry import plugins
from brushexp.registry.loading import broken_files, load_plugins
names = load_plugins(Path("plugins"), warns=False)
broken = [*broken_files().values()]
for plugin in plugins():
    if not plugin.is_ours:
        try:
            plugin.cls
        except UserError as error:
            broken.append(str(error))
print(json.dumps({"names": names, "broken": broken}))
"""
CONFIGS = """
import json
from pathlib import Path
from brushexp.config.own_files import problems_in
print(json.dumps({"broken": [problem for _, problem in problems_in(Path("conf"))]}))
"""
PROBES = {"torch": TORCH, "numba": NUMBA, "plugins": PLUGINS, "configs": CONFIGS}
Probes = Mapping[str, Future[dict[str, Any]]]


class Broken(Exception):
    """Raised for a broken part of the installation; the message becomes the text of that part's line."""


def examine() -> int:
    """Print the report's fifteen lines; return exit code 1 if something is broken, otherwise 0."""
    exit_code = 0
    with ThreadPoolExecutor(len(PROBES)) as pool:
        probes = {name: pool.submit(_run, code) for name, code in PROBES.items()}
        for name, describe in _lines(probes).items():
            mark = " "
            try:
                text = describe()
            except Broken as error:
                mark, text, exit_code = "!", str(error), 1
            except Exception as error:  # one failure must not hide the other lines
                mark, text, exit_code = "!", f"unknown: {type(error).__name__}: {error}", 1
            print(f"{mark} {name:<{COLUMN}}{_without_home(' '.join(text.split()))}", flush=True)
    return exit_code


def _lines(probes: Probes) -> dict[str, Callable[[], str]]:
    return {
        "brushexp": _program,
        "Python": lambda: f"{platform.python_version()}, {sys.executable}",
        "system": platform.platform,
        "processor": lambda: f"{processor()}, {_cores()} cores for this process",
        "environment": _environment,
        "PyTorch": lambda: str(probes["torch"].result()["version"]),
        "GPU": lambda: _gpu(probes["torch"].result()),
        "Numba": lambda: str(probes["numba"].result()["version"]),
        "kernels": lambda: _kernels(probes["numba"].result()["folder"]),
        "libraries": _libraries,
        "extras": lambda: ", ".join(_extras()[0]) or "none",
        "missing": _missing_extras,
        "configs": lambda: _configs(probes["configs"].result()),
        "plugins": lambda: _plugins(probes["plugins"].result()),
        "packages": _packages,
    }


def _run(code: str) -> dict[str, Any]:
    """Run a probe in its own process and return the data it prints; raise Broken with the reason if it fails."""
    try:
        done = subprocess.run(
            [sys.executable, "-P", "-c", code],
            capture_output=True,
            timeout=PATIENCE,
            check=False,
            text=True,
            errors="replace",
        )
    except subprocess.TimeoutExpired as error:
        raise Broken(f"no answer within {PATIENCE} seconds") from error
    if done.returncode:
        reason = done.stderr.strip().splitlines()[-1:] or [f"the import ends Python with exit code {done.returncode}"]
        raise Broken(reason[0])
    result: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return result


def _program() -> str:
    state = code_state()
    commit = f", commit {state['commit'][:12]}" if "commit" in state else ""
    changed = " with changes" if state.get("dirty") else ""
    line = f"{__version__}{commit}{changed}, in {PACKAGE}"
    try:
        installed = version("brushexp")
    except PackageNotFoundError as error:
        raise Broken(f"{line}; it is not installed, so it has no packages: pip install .") from error
    return line if installed == __version__ else f"{line}; installed as {installed}: install it again"


def _cores() -> int:
    from brushexp.system.runtime import cores  # noqa: PLC0415  (only one line fails if this does)

    return cores()


def _environment() -> str:
    variables = [f"{name}={os.environ[name]}" for name in VARIABLES if name in os.environ]
    return ", ".join([f"{sys.stdout.encoding} output", *(variables or ["no thread or device variables set"])])


def _gpu(torch: Mapping[str, Any]) -> str:
    if torch["gpu"] is None:
        return "PyTorch finds none" if torch["cuda"] else "none: this PyTorch is a CPU-only build"
    try:
        return f"{torch['gpu']}, CUDA {torch['cuda']}, Triton {version('triton')}"
    except PackageNotFoundError as error:
        cure = "pip install 'brushexp[gpu]'"
        raise Broken(f"{torch['gpu']}, CUDA {torch['cuda']}, but no Triton for its kernels: {cure}") from error


def _kernels(folder: str | None) -> str:
    if folder is None or not can_hold(Path(folder)):
        raise Broken("compiled kernels cannot be stored; set NUMBA_CACHE_DIR to a writable folder")
    place = "beside the program's code" if Path(folder).is_relative_to(PACKAGE) else f"in {folder}"
    return f"stored {place}, which is writable"


def _libraries() -> str:
    wrong = [text for text, is_there in _requirements("") if not is_there]
    if wrong:
        raise Broken(f"missing or too old: pip install {' '.join(map(repr, wrong))}")
    return "all required libraries are installed"


def _extras() -> tuple[list[str], list[str]]:
    """List the installed and the missing extras, omitting those without libraries for this system."""
    names = distribution("brushexp").metadata.get_all("Provides-Extra") or []
    extras = {
        name: [is_there for _, is_there in _requirements(name)] for name in sorted(set(names) - {*FOR_DEVELOPERS})
    }
    installed = [name for name, libraries in extras.items() if libraries and all(libraries)]
    return installed, [name for name, libraries in extras.items() if not all(libraries)]


def _missing_extras() -> str:
    missing = ",".join(_extras()[1])
    return f"{missing}; to add all: pip install 'brushexp[{missing}]'" if missing else "none"


def _requirements(extra: str) -> Iterable[tuple[str, bool]]:
    """Yield each requirement of an extra ("" for brushexp itself) on this system, and whether it is installed."""
    from packaging.requirements import Requirement  # noqa: PLC0415  (it may be missing)

    for text in distribution("brushexp").requires or ():
        requirement = Requirement(text)
        marker = requirement.marker
        is_for_all = marker is None or marker.evaluate({"extra": ""})
        is_for_extra = marker is not None and not is_for_all and marker.evaluate({"extra": extra})
        if is_for_extra if extra else is_for_all:
            try:
                is_there = requirement.specifier.contains(version(requirement.name), prereleases=True)
            except PackageNotFoundError:
                is_there = False
            yield f"{requirement.name}{requirement.specifier}", is_there


def _configs(probed: Mapping[str, Any]) -> str:
    if probed["broken"]:
        raise Broken("; ".join(probed["broken"]))
    names = sorted(f"{path.parent.name}/{path.stem}" for path in Path("conf").glob("*/*.yaml"))
    return f"in conf/: {', '.join(names)}" if names else "none of your own in conf/"


def _plugins(probed: Mapping[str, Any]) -> str:
    if probed["broken"]:
        raise Broken("; ".join(probed["broken"]))
    folders = ["plugins/", *filter(None, os.environ.get("BRUSHEXP_PLUGINS", "").split(os.pathsep))]
    return f"{', '.join(probed['names']) or 'none of your own'} in {', '.join(folders)}"


def _packages() -> str:
    groups = [name for name in entry_points().groups if name.startswith("brushexp.")]
    owners = [point.dist for group in groups for point in entry_points(group=group) if point.dist is not None]
    names = {f"{owner.name} {owner.version}" for owner in owners if owner.name != "brushexp"}
    return ", ".join(sorted(names)) or "none"


def _without_home(text: str) -> str:
    home = home_folder()
    return text if home is None else text.replace(f"{home}{os.sep}", f"~{os.sep}")
