"""``task=paint``: optimise a catalogue of strokes until it looks like the picture."""

from pathlib import Path

from omegaconf import DictConfig

from brushexp.app.fitting import interrupted_run
from brushexp.app.session import painted_into


def run(cfg: DictConfig, folder: Path, start: float) -> dict[str, object]:
    """Paint one picture, write everything into the run's folder, and return the numbers of metrics.json."""
    if cfg.get("resume") is None:
        return painted_into(folder, cfg, start).metrics
    checkpoint, cfg = interrupted_run(Path(cfg.resume), cfg)
    return painted_into(folder, cfg, None, checkpoint).metrics
