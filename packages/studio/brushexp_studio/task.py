"""``task=studio``: paint photographs in the browser on this machine."""

import logging
from pathlib import Path
from tempfile import TemporaryDirectory

from omegaconf import DictConfig

from brushexp.contracts import UserError
from brushexp_studio.serving import show_until_interrupted

log = logging.getLogger(__name__)


def run(cfg: DictConfig, folder: Path, start: float) -> dict[str, object]:
    """Serve the studio until Ctrl-C; then remove all uploads and, unless they are kept, all paintings."""
    try:
        from brushexp_studio.server import open_studio  # noqa: PLC0415  (an extra)
    except ModuleNotFoundError as error:
        raise UserError("task=studio needs nicegui; pip install 'brushexp[studio]'") from error
    if cfg.keep is not None:
        try:
            Path(cfg.keep).mkdir(parents=True, exist_ok=True)
            TemporaryDirectory(dir=cfg.keep).cleanup()
        except OSError as error:
            cure = "choose another folder"
            raise UserError(f"cannot write into keep={cfg.keep}: {error.strerror}; {cure}") from error
    with TemporaryDirectory(prefix="brushexp-studio-", ignore_cleanup_errors=True) as own:
        options = {"seed": cfg.seed, "device": cfg.device, "threads": cfg.threads}
        results = Path(own) if cfg.keep is None else Path(cfg.keep)
        with open_studio(Path(own), results, cfg.port, options) as (address, works):
            log.info("the studio runs at %s until Ctrl-C", address)
            show_until_interrupted(address, in_browser=cfg.open)
        paintings = len(works.all)
    log.info("the studio is closed; %s", f"paintings are in {results}" if cfg.keep else "nothing was kept")
    return {"paintings": paintings}
