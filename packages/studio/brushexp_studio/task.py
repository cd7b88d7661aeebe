"""``task=studio``: paint one's own photographs in the browser, on this machine."""

import logging
from pathlib import Path
from tempfile import TemporaryDirectory

from omegaconf import DictConfig

from brushexp.errors import UserError
from brushexp.pages.serving import show_until_interrupted

log = logging.getLogger(__name__)


def run(cfg: DictConfig, folder: Path, start: float) -> dict[str, object]:
    """Serve the studio until Ctrl-C; what it was given goes then, and so do its paintings, unless they are kept."""
    try:
        from brushexp_studio.server import opened_studio  # noqa: PLC0415  (an extra)
    except ModuleNotFoundError as error:
        raise UserError("task=studio needs nicegui; pip install 'brushexp[studio]'") from error
    if cfg.keep is not None:
        check_writable(Path(cfg.keep))
    with TemporaryDirectory(prefix="brushexp-studio-", ignore_cleanup_errors=True) as own:
        options = {"seed": cfg.seed, "device": cfg.device, "threads": cfg.threads}
        kept = Path(own) if cfg.keep is None else Path(cfg.keep)
        with opened_studio(Path(own), kept, cfg.port, options) as (address, works):
            log.info("the studio is at %s until Ctrl-C", address)
            show_until_interrupted(address, in_browser=cfg.open)
        paintings = len(works.all)
    log.info("the studio is closed; %s", f"paintings are in {kept}" if cfg.keep else "nothing of it is kept")
    return {"paintings": paintings}


def check_writable(folder: Path) -> None:
    """Make a folder in which paintings will be kept; UserError if they cannot."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        TemporaryDirectory(dir=folder).cleanup()
    except OSError as error:
        raise UserError(f"cannot write into keep={folder}: {error.strerror}; choose another folder") from error
