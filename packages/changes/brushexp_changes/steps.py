"""Check that the painter takes optimisation steps, which some changes require."""

from omegaconf import DictConfig

from brushexp.contracts import UserError, keep_built, plugin_of
from brushexp.contracts.families import Painter


def check_steps(cfg: DictConfig, word: str) -> None:
    """Raise UserError for painters other than gradient; ``word`` is the typed setting, such as ``guides=lines.png``."""
    if isinstance(keep_built(cfg.painter), Painter):
        key, painter = word.partition("=")[0], plugin_of(cfg.painter).name
        raise UserError(f"{word} is for painter=gradient, not {painter}; drop painter, or drop {key}")
