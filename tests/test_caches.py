"""Tests of where caches are stored if there is no home folder, or if the home or the installation is read-only."""

import errno
import logging
import os
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest
from numba.core import caching
from refusals import refuses

from brushexp.compat import compiled, kept_kernels
from brushexp.config.words import expand_home
from brushexp.system import caches
from brushexp.system.caches import CACHES, KERNELS, can_hold, has_home, private_folder, settle_caches

UNWRITABLE = "/proc/none"  # not even for root
VARIABLES = ("HOME", KERNELS, CACHES, *caches.LIBRARY_CACHES, *caches.TEMPORARY_PLACES)


@pytest.fixture
def surroundings(tmp_path, monkeypatch):
    """Return a function that sets environment variables and the folder in which the program seems to be installed.

    The other ``VARIABLES`` are unset, and temporary files go to ``tmp_path``.
    """

    def surround(code: str | Path = UNWRITABLE, **environment: str) -> None:
        for name in VARIABLES:
            monkeypatch.setenv(name, "")  # so that it is restored at the end
            monkeypatch.delenv(name)
        (tmp_path / "tmp").mkdir(exist_ok=True)
        for name, value in ({"TMPDIR": str(tmp_path / "tmp")} | environment).items():
            monkeypatch.setenv(name, value)
        monkeypatch.setattr(caches.tempfile, "tempdir", None)  # tempfile chooses it only once
        monkeypatch.setattr(caches, "CODE", Path(code))
        has_home.cache_clear()

    monkeypatch.chdir(tmp_path)
    yield surround
    monkeypatch.undo()
    has_home.cache_clear()


def nobody(monkeypatch) -> None:
    """Simulate a user who has no entry in the password database."""
    monkeypatch.setattr("pwd.getpwuid", lambda number: {}[number])


def test_a_user_whose_home_can_be_written_keeps_all_as_it_is(surroundings, tmp_path):
    surroundings(HOME=str(tmp_path))
    settle_caches()
    assert not {KERNELS, CACHES, *caches.LIBRARY_CACHES} & os.environ.keys()
    assert not (tmp_path / ".cache").exists()


@pytest.mark.parametrize("home", [None, "/", UNWRITABLE, "", "relative", "~"])
@pytest.mark.parametrize("is_installed_read_only", [False, True])
def test_without_a_home_to_write_into_caches_are_in_a_private_folder(
    surroundings, tmp_path, monkeypatch, home, is_installed_read_only
):
    surroundings(UNWRITABLE if is_installed_read_only else tmp_path, **({} if home is None else {"HOME": home}))
    nobody(monkeypatch)
    settle_caches()
    private = tmp_path / "tmp" / f"brushexp-{os.getuid()}"
    assert os.environ[CACHES] == str(private)
    assert os.environ["MPLCONFIGDIR"] == str(private / "matplotlib")
    assert os.environ.get(KERNELS) == (str(private / "kernels") if is_installed_read_only else None)
    assert private.stat().st_mode & 0o777 == 0o700
    assert os.path.isabs(os.path.expanduser("~"))
    assert [path.name for path in tmp_path.iterdir()] == ["tmp"]


@pytest.mark.parametrize("variable", [KERNELS, CACHES])
def test_a_typed_place_counts_in_full_and_is_forgotten_where_nothing_can_be_written(surroundings, tmp_path, variable):
    home = {"HOME": str(tmp_path)}
    for typed in (str(tmp_path / "kept"), "~/kept"):
        surroundings(**home, **{variable: typed})
        settle_caches()
        assert os.environ[variable] == str(tmp_path / "kept")
    for typed in (UNWRITABLE, "", "~nobodyofthisname/kept"):
        surroundings(**home, **{variable: typed})
        settle_caches()
        assert variable not in os.environ
    surroundings(**home, **{variable: "kept"})
    settle_caches()
    assert os.environ.get(variable) == (str(tmp_path / "kept") if variable == KERNELS else None)
    surroundings(HOME=UNWRITABLE, **{CACHES: str(tmp_path / "kept")})
    settle_caches()
    assert os.environ[CACHES] == str(tmp_path / "kept")


def test_a_private_folder_is_nobody_elses(surroundings, tmp_path, monkeypatch):
    surroundings()
    folder = tmp_path / "tmp" / f"brushexp-{os.getuid()}"
    (tmp_path / "elsewhere").mkdir(mode=0o700)
    folder.symlink_to(tmp_path / "elsewhere")
    assert private_folder() is None
    folder.unlink()
    folder.mkdir(mode=0o755)
    assert private_folder() is None
    folder.chmod(0o700)
    assert private_folder() == folder
    other = os.getuid() + 1
    monkeypatch.setattr(os, "getuid", lambda: other)
    folder.rename(folder.with_name(f"brushexp-{other}"))
    assert private_folder() is None


def test_where_no_folder_is_temporary_none_is_made_in_the_folder_of_the_command(surroundings, tmp_path, monkeypatch):
    surroundings(HOME=UNWRITABLE, TMPDIR=UNWRITABLE)
    monkeypatch.setattr(caches.tempfile, "gettempdir", os.getcwd)
    settle_caches()
    assert CACHES not in os.environ
    assert [path.name for path in tmp_path.iterdir()] == ["tmp"]


def test_what_cannot_be_made_can_hold_nothing(tmp_path):
    assert can_hold(tmp_path / "a" / "b")
    assert not (tmp_path / "a").exists()
    (tmp_path / "file").touch()
    assert not can_hold(tmp_path / "file" / "b")
    assert not can_hold(Path(UNWRITABLE))


def test_a_typed_home_is_refused_where_there_is_none(surroundings, monkeypatch):
    surroundings()
    nobody(monkeypatch)
    settle_caches()
    refuses(
        r"^output=~/x: this user has no home folder; write the path in full, output=/\.\.\.$", expand_home, "output=~/x"
    )


@compiled.function
def double(values):  # pragma: no cover
    for k in range(len(values)):
        values[k] *= 2


def doubled() -> float:
    """Compile ``double`` again, and return the result of calling it with 1."""
    values = np.ones(2)
    compiled.Compiled(double.function, {})(values)
    return values[0]


@pytest.fixture
def kernels(tmp_path, monkeypatch):
    """Store compiled code in the test's own folder, and return that folder."""
    monkeypatch.setattr(kept_kernels, "_unkept", set())
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    monkeypatch.setattr("numba.core.config.reload_config", lambda: None)  # it would read the environment again
    return tmp_path


def test_without_any_place_functions_are_compiled_and_a_line_says_so(kernels, monkeypatch, caplog):
    monkeypatch.setattr(numba.config, "CACHE_LOCATOR_CLASSES", "UserProvidedCacheLocator")
    monkeypatch.setattr(numba.config, "CACHE_DIR", UNWRITABLE)
    with caplog.at_level(logging.WARNING):
        assert doubled() == doubled() == 2
    assert [record.message for record in caplog.records] == [
        "compiled code cannot be stored, so every run compiles again; "
        "to choose a folder for it, put NUMBA_CACHE_DIR=FOLDER before the command"
    ]
    assert not kept_kernels.is_kept()


def test_a_disk_that_is_full_keeps_nothing_and_ends_no_run(kernels, monkeypatch, caplog):
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(caching.IndexDataCacheFile, "save", full)
    assert doubled() == 2
    assert "cannot be stored" in caplog.text


@pytest.mark.parametrize("damage", [b"", b"\x80", b"\x80\x04]\x94.", bytes(range(256))])
def test_what_is_damaged_of_kept_code_is_compiled_and_kept_again(kernels, damage):
    assert doubled() == 2
    whole = {path: path.stat().st_size for path in kernels.rglob("*.nb*")}
    assert len(whole) == 2
    for path in whole:
        path.write_bytes(damage)
        assert doubled() == 2
    assert {path: path.stat().st_size for path in kernels.rglob("*.nb*")} == whole
    assert kept_kernels.is_kept()


SCRIPT = """
import logging, os, sys
logging.basicConfig(format="%(message)s")
import brushexp
from test_caches import double, doubled
assert doubled() == 2
print(double.dispatcher._cache.cache_path, *sorted(os.listdir()))
"""


@pytest.mark.slow
@pytest.mark.parametrize("home", [None, "/", UNWRITABLE])
def test_a_kernel_is_kept_by_a_user_without_a_home_and_an_installation_of_their_own(tmp_path, home):
    (tmp_path / "sitecustomize.py").write_text("import pwd\npwd.getpwuid = lambda number: {}[number]\n")
    (tmp_path / "here").mkdir()
    environment = {name: value for name, value in os.environ.items() if name not in VARIABLES}
    environment |= {} if home is None else {"HOME": home}
    environment |= {"TMPDIR": str(tmp_path), "NUMBA_CACHE_LOCATOR_CLASSES": "UserWideCacheLocator"}
    environment["PYTHONPATH"] = os.pathsep.join([str(tmp_path), str(Path(__file__).parent)])
    command = [sys.executable, "-W", "ignore", "-c", SCRIPT]
    done = subprocess.run(command, cwd=tmp_path / "here", env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.strip().startswith(str(tmp_path / f"brushexp-{os.getuid()}"))
    assert len(done.stdout.split()) == 1  # the working folder stays empty
    assert done.stderr == ""
