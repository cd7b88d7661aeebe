"""The program many times over: each run is a fork of one process that has imported everything, and may be killed."""

import gc
import importlib
import os
import runpy
import signal
import sys
import traceback
import warnings
from multiprocessing.connection import Connection
from pathlib import Path

from program import FORKS, ROOT, in_plain

Kill = tuple[str, int, bool]


class Zygote:
    """Runs ``python run.py`` in forks; used in ``with``.

    >>> with Zygote() as zygote:
    ...     zygote.run(Path("."), "task=compare")[0]
    1
    """

    def __enter__(self) -> "Zygote":
        self.pipe, theirs = FORKS.Pipe()
        self.process = FORKS.Process(target=_serve, args=(theirs,))
        self.process.start()
        theirs.close()
        return self

    def __exit__(self, *_: object) -> None:
        self.pipe.close()
        self.process.join(20)
        self.process.kill()

    def run(
        self, cwd: Path, *words: str, kill: Kill | None = None, sent: int = signal.SIGKILL, **patched: int
    ) -> tuple[int, str]:
        """Exit code (negative: the signal that ended it) and output.

        Args:
            cwd: where the program runs.
            words: of the command line.
            kill: which file the run is about to move to its place when it gets a signal: the end of its path, and the
                how manieth of those; True: after that.
            sent: the signal.
            patched: constants of `brushexp.training.writer` that are other numbers.
        """
        self.pipe.send((cwd, in_plain(words), kill, sent, patched))
        assert self.pipe.poll(200), f"{' '.join(words)} does not end"
        return self.pipe.recv()


def _serve(pipe: Connection) -> None:
    """Fork for every request until there are no more."""
    gc.freeze()
    while True:
        try:
            request = pipe.recv()
        except EOFError:
            return
        said = Path(request[0], f".said-{os.getpid()}")
        if not (child := os.fork()):
            _run(said, *request)
        _, status = os.waitpid(child, 0)
        pipe.send((os.waitstatus_to_exitcode(status), said.read_text(errors="replace")))
        said.unlink()


def _run(said: Path, cwd: Path, words: tuple[str, ...], kill: Kill | None, sent: int, patched: dict[str, int]) -> None:
    """What a fork does; it never returns."""
    code = 1
    try:
        for number in (1, 2):
            os.dup2(os.open(said, os.O_CREAT | os.O_WRONLY | os.O_APPEND), number)
        os.chdir(cwd)
        signal.signal(signal.SIGINT, signal.default_int_handler)
        for number in (signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, signal.SIG_DFL)
        warnings.simplefilter("ignore", FutureWarning)
        writer = importlib.import_module("brushexp.training.writer")
        for name, value in patched.items():
            setattr(writer, name, value)
        if kill:
            _kill_at(*kill, sent)
        sys.argv = [str(ROOT / "run.py"), *words]
        runpy.run_path(sys.argv[0], run_name="__main__")
        code = 0
    except SystemExit as end:
        if isinstance(end.code, str):
            print(end.code, file=sys.stderr)
        code = end.code if isinstance(end.code, int) else int(end.code is not None)
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def _kill_at(name: str, number: int, after: bool, sent: int) -> None:
    """Let this process get a signal when it moves a file to its place."""
    real, moved = os.replace, 0

    def replace(source: Path, target: Path) -> None:
        nonlocal moved
        moved += (ours := str(target).endswith(name))
        if ours and moved == number and not after:
            os.kill(os.getpid(), sent)
        real(source, target)
        if ours and moved == number and after:
            os.kill(os.getpid(), sent)

    os.replace = replace
