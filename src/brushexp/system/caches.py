"""Choose cache folders for libraries, even if the user has no writable home folder."""

import os
import stat
import tempfile
from functools import cache
from pathlib import Path

CODE = Path(__file__).parents[1]
KERNELS = "NUMBA_CACHE_DIR"  # environment variable: folder for compiled machine code
CACHES = "XDG_CACHE_HOME"  # environment variable: all caches of a user (XDG Base Directory Specification)
LIBRARY_CACHES = {  # variables of libraries that ignore this standard -> subfolders
    "MPLCONFIGDIR": "matplotlib",
    "TRITON_CACHE_DIR": "triton",
    "WANDB_CACHE_DIR": "wandb-cache",
    "WANDB_DATA_DIR": "wandb-data",
}
TEMPORARY_PLACES = ("TMPDIR", "TEMP", "TMP")  # variables that name folders for temporary files
USUAL_PLACES = ("/tmp", "/var/tmp", "/usr/tmp")  # the usual folders without these variables
PRIVATE = 0o700  # mode of a folder that only its owner can read and write


def settle_caches() -> None:
    """Give libraries writable cache folders if they would otherwise have none; call this before importing them.

    Machine code is cached in the first writable folder among `NUMBA_CACHE_DIR`, the program's own folder, the user's
    cache and a private temporary folder. Other libraries use the last two. If no folder is writable, nothing is cached.
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
        os.environ["HOME"] = str(private)  # otherwise libraries create a folder named ~
    if is_settled:
        return
    os.environ[CACHES] = str(private)
    for variable, name in LIBRARY_CACHES.items():
        os.environ.setdefault(variable, str(private / name))
    if not can_hold(CODE / "__pycache__"):
        os.environ.setdefault(KERNELS, str(private / "kernels"))


def _settle_typed(variable: str) -> None:
    """Make the path of a cache folder in an environment variable absolute; unset it if the folder is unusable."""
    typed = os.environ.pop(variable, "")
    path = os.path.expanduser(typed)
    is_whole = os.path.isabs(path) or (variable == KERNELS and not path.startswith("~"))
    if path and is_whole and can_hold(place := Path(os.path.abspath(path))):
        os.environ[variable] = str(place)


@cache
def has_home() -> bool:
    """Return whether the user's home folder was known at the first call, before `settle_caches` sets ``HOME``."""
    return os.path.isabs(os.path.expanduser("~"))  # unlike pathlib's version, it never raises


def home_folder() -> Path | None:
    """Return the user's home folder, or None if it is unknown or is the root of the file system."""
    path = os.path.expanduser("~")
    return Path(path) if has_home() and os.path.normpath(path) != os.sep else None


def can_hold(folder: Path) -> bool:
    """Return whether files can be written to a folder or, if it does not exist, to its nearest existing parent."""
    try:
        while not folder.exists():
            folder = folder.parent
        tempfile.TemporaryFile(dir=folder).close()  # permissions are unreliable for root, /proc and read-only disks
    except OSError:
        return False
    return True


def private_folder() -> Path | None:
    """Create a temporary folder that only this user can read and write; return None if that is impossible.

    A folder that others may have written to is never used, because the program loads machine code from it.
    """
    if not hasattr(os, "getuid"):
        return None  # on Windows, permission bits do not show who may write
    try:
        parent = tempfile.gettempdir()
    except OSError:
        return None
    named = {os.path.abspath(os.environ[name]) for name in TEMPORARY_PLACES if os.environ.get(name)}
    if os.path.abspath(parent) not in named | {*USUAL_PLACES}:
        return None  # Python's last resort, the current folder
    folder = Path(parent, f"brushexp-{os.getuid()}")
    try:
        folder.mkdir(mode=PRIVATE, exist_ok=True)
        status = folder.lstat()
    except OSError:
        return None
    is_ours = stat.S_ISDIR(status.st_mode) and status.st_uid == os.getuid()
    return folder if is_ours and stat.S_IMODE(status.st_mode) == PRIVATE and can_hold(folder) else None
