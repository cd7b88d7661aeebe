"""Helpers that run the program in separate processes without spending seconds on imports.

Every process is forked from a server that has only imported all modules and filled Numba's tables. A fork behaves like
``brushexp``: it has its own environment, working folder, output, signals and exit code.
"""

import http.client
import multiprocessing
import os
import pkgutil
import shutil
import signal
import sys
import tempfile
import warnings
from collections.abc import Callable, Sequence
from functools import cache
from multiprocessing import forkserver
from pathlib import Path
from subprocess import CompletedProcess, TimeoutExpired
from urllib.parse import urlsplit

import brushexp_training
import pytest

import brushexp.__main__
from brushexp.system.published import entry_points_of

ROOT = Path(__file__).parents[1]
THEIRS = ["antlr4.LL1Analyzer", "av", "filelock", "hydra.main", "jinja2", "lightning.pytorch.callbacks"]
THEIRS += ["PIL.GifImagePlugin", "skimage.data", "skimage.segmentation.slic_superpixels"]
THEIRS += ["torchmetrics.functional.image"]
OURS = [
    module.name
    for it in (brushexp, brushexp_training)
    for module in pkgutil.walk_packages(it.__path__, f"{it.__name__}.")
]
OURS += [
    point.module
    for group in ("plugins", "tasks", "stand_ins")
    for point in entry_points_of(f"brushexp.{group}").values()
]
FORKS = multiprocessing.get_context("forkserver")
FORKS.set_forkserver_preload(["ready", *THEIRS, *OURS])
Kill = tuple[str, int, bool]


class Program:
    """A process that runs ``brushexp`` with overrides in the folder ``cwd``; it has methods of `subprocess.Popen`.

    ``kill`` is a tuple of a path suffix, a count n and a flag: the program receives the signal ``sent`` just before
    a file with that suffix is moved into place for the n-th time, or just after the move if the flag is true.
    """

    def __init__(
        self, *overrides: str, cwd: Path, kill: Kill | None = None, sent: int = signal.SIGKILL, **environment: str
    ) -> None:
        self.args = ["brushexp", *in_plain(overrides)]
        self._outputs = Path(tempfile.mkdtemp())
        environment = {**os.environ, "BRUSHEXP_PLUGINS": str(ROOT / "plugins"), **environment}
        disturbed = (*kill, sent) if kill else None
        arguments = (self.args, str(cwd), environment, self._outputs, disturbed)
        self._process = FORKS.Process(target=_main, args=arguments)
        start_server()
        self._process.start()

    @property
    def returncode(self) -> int | None:
        return self._process.exitcode

    def poll(self) -> int | None:
        return self._process.exitcode

    def send_signal(self, number: int) -> None:
        if self.poll() is None:
            os.kill(self._process.pid, number)

    def communicate(self, timeout: float = 280) -> tuple[str, str]:
        """Wait for the process to end, and return its stdout and stderr."""
        self._process.join(timeout)
        if self.poll() is None:
            self._process.kill()
            raise TimeoutExpired(self.args, timeout)
        out, err = ((self._outputs / name).read_text(errors="replace") for name in ("out", "err"))
        shutil.rmtree(self._outputs)
        return out, err


@cache
def start_server() -> None:
    """Start the server from which processes are forked, with the tests' folder on its module search path."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv("PYTHONPATH", str(Path(__file__).parent), prepend=os.pathsep)
        forkserver.ensure_running()


def in_plain(words: Sequence[str]) -> list[str]:
    """Add ``look=plain`` to a painting command that names no look, because few tests are about looks."""
    if any(word.startswith(("task=", "look=", "experiment=", "resume=", "--")) for word in words):
        return [*words]
    flags = next((k for k, word in enumerate(words) if not word.startswith("-")), len(words))
    return [*words[:flags], "look=plain", *words[flags:]]


def run(*overrides: str, cwd: Path, **environment: str) -> CompletedProcess:
    """Run the program in a separate process and wait for it to finish."""
    program = Program(*overrides, cwd=cwd, **environment)
    out, err = program.communicate()
    return CompletedProcess(program.args, program.returncode, out, err)


def ended(cwd: Path, *words: str, kill: Kill | None = None, sent: int = signal.SIGKILL) -> tuple[int, str]:
    """Run a `Program`, and return its exit code (negative if a signal ended it) and its output."""
    program = Program(*words, cwd=cwd, kill=kill, sent=sent)
    output = "".join(program.communicate())
    return program.returncode, output


def disturb_move(name: str, number: int, after: bool, disturb: Callable[[], object]) -> None:
    """Call ``disturb`` just before or after the ``number``-th move of a file that ends in ``name`` into place."""
    real, moved = os.replace, 0

    def replace(source: Path, target: Path) -> None:
        nonlocal moved
        moved += (ours := str(target).endswith(name))
        if ours and moved == number and not after:
            disturb()
        real(source, target)
        if ours and moved == number and after:
            disturb()

    os.replace = replace


def publish(folder: Path, name: str, version: str, points: dict[str, str]) -> None:
    """Write the metadata of a package with plugin entry points to a folder, as pip would."""
    info = folder / f"{name.replace('-', '_')}-{version}.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")
    lines = [f"{point} = {value}" for point, value in points.items()]
    (info / "entry_points.txt").write_text("\n".join(["[brushexp.plugins]", *lines]))


def ask(
    address: str, path: str, method: str = "GET", body: bytes | None = None, **headers: str
) -> tuple[int, bytes, dict[str, str]]:
    """Send an HTTP request, and return the status, body and headers of the response."""
    connection = http.client.HTTPConnection(urlsplit(address).netloc, timeout=30)
    connection.request(method, path, body, {name.replace("_", "-"): value for name, value in headers.items()})
    answer = connection.getresponse()
    response = answer.status, answer.read(), dict(answer.getheaders())
    connection.close()
    return response


def _main(
    words: list[str], folder: str, environment: dict[str, str], outputs: Path,
    disturbed: tuple[str, int, bool, int] | None,
) -> None:  # fmt: skip
    """Run the command ``words`` in a fork, as under ``python -W ignore::FutureWarning``."""
    for number, name in ((1, "out"), (2, "err")):
        os.dup2(os.open(outputs / name, os.O_CREAT | os.O_WRONLY | os.O_APPEND), number)
    os.environ.clear()
    os.environ.update(environment)
    os.chdir(folder)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    for number in (signal.SIGTERM, signal.SIGHUP):  # the process that started the tests may ignore them
        signal.signal(number, signal.SIG_DFL)
    warnings.simplefilter("ignore", FutureWarning)
    if disturbed:
        *move, sent = disturbed
        disturb_move(*move, lambda: os.kill(os.getpid(), sent))
    sys.argv = words
    brushexp.__main__.main()
