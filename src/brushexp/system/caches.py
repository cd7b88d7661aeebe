"""Choose where libraries keep what they have compiled or looked up, also for a user whose home cannot be written."""

import os
import stat
import tempfile
from functools import cache
from pathlib import Path

CODE = Path(__file__).parents[1]
KERNELS = "NUMBA_CACHE_DIR"  # variable of the environment: where machine code is kept
CACHES = "XDG_CACHE_HOME"  # that of all caches of a user (XDG Base Directory Specification)
OF_LIBRARIES = {  # variables of libraries that heed no such standard, and what each keeps in its folder
    "MPLCONFIGDIR": "matplotlib",
    "TRITON_CACHE_DIR": "triton",
    "WANDB_CACHE_DIR": "wandb-cache",
    "WANDB_DATA_DIR": "wandb-data",
}
TEMPORARY_PLACES = ("TMPDIR", "TEMP", "TMP")  # variables that name them
USUAL_PLACES = ("/tmp", "/var/tmp", "/usr/tmp")  # and where they are without these
PRIVATE = 0o700  # mode of a folder that others can neither write into nor read


def settle_caches() -> None:
    """Give libraries a place to write into where they would find none; call it before they are imported.

    Machine code is kept where `NUMBA_CACHE_DIR` says, else beside the program's code, else in the cache of the user,
    else in a private temporary folder; other libraries use the latter two. Nothing is kept where none can be written.
    """
    for variable in (KERNELS, CACHES):
        _settle_typed(variable)
    home = home_folder()
    is_settled = CACHES in os.environ or (home is not None and can_hold(home / ".cache"))
    if is_settled and has_home():
        return
    private = private_folder()
    if private is None:
        return
    if not has_home():
        os.environ["HOME"] = str(private)  # else libraries make a folder named ~
    if is_settled:
        return
    os.environ[CACHES] = str(private)
    for variable, name in OF_LIBRARIES.items():
        os.environ.setdefault(variable, str(private / name))
    if not can_hold(CODE / "__pycache__"):
        os.environ.setdefault(KERNELS, str(private / "kernels"))


def _settle_typed(variable: str) -> None:
    """Write a place of caches that somebody has typed in full, and forget it if nothing can be written there."""
    typed = os.environ.pop(variable, "")
    path = os.path.expanduser(typed)
    is_whole = os.path.isabs(path) or (variable == KERNELS and not path.startswith("~"))
    if path and is_whole and can_hold(place := Path(os.path.abspath(path))):
        os.environ[variable] = str(place)


@cache
def has_home() -> bool:
    """Tell whether the user has a home, as it was when this was first asked: `settle_caches` lends libraries one."""
    return os.path.isabs(os.path.expanduser("~"))  # unlike that of pathlib it never raises


def home_folder() -> Path | None:
    """Return the home of the user; None if there is none, or only the root of the file system."""
    path = os.path.expanduser("~")
    return Path(path) if has_home() and os.path.normpath(path) != os.sep else None


def can_hold(folder: Path) -> bool:
    """Test whether files can be written into a folder, which may have to be made."""
    try:
        while not folder.exists():
            folder = folder.parent
        tempfile.TemporaryFile(dir=folder).close()  # rights say too much: of root, of /proc, of read-only disks
    except OSError:
        return False
    return True


def private_folder() -> Path | None:
    """Make a temporary folder of this user that nobody else can read or write; None if there can be none.

    What others could have put there is never trusted: machine code is loaded from it.
    """
    if not hasattr(os, "getuid"):
        return None  # Windows, where rights say nothing about who may write
    try:
        parent = tempfile.gettempdir()
    except OSError:
        return None
    named = {os.path.abspath(os.environ[name]) for name in TEMPORARY_PLACES if os.environ.get(name)}
    if os.path.abspath(parent) not in named | {*USUAL_PLACES}:
        return None  # Python's last resort: the folder in which the command was typed
    folder = Path(parent, f"brushexp-{os.getuid()}")
    try:
        folder.mkdir(mode=PRIVATE, exist_ok=True)
        status = folder.lstat()
    except OSError:
        return None
    is_ours = stat.S_ISDIR(status.st_mode) and status.st_uid == os.getuid()
    return folder if is_ours and stat.S_IMODE(status.st_mode) == PRIVATE and can_hold(folder) else None
