"""``task=paint``: optimise a catalogue of strokes until it looks like the picture."""

from pathlib import Path

from omegaconf import DictConfig

from brushexp.runs.fitting import interrupted_run
from brushexp.runs.session import painted_into


def run(cfg: DictConfig, folder: Path, start: float) -> dict[str, object]:
    """Paint a picture, write everything into the run's folder, and return the numbers of metrics.json."""
    checkpoint = None
    if cfg.get("resume") is not None:
        checkpoint, cfg = interrupted_run(Path(cfg.resume), cfg)
    return painted_into(folder, cfg, None if checkpoint else start, checkpoint).metrics
