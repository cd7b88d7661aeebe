"""Weights of renderers on disk, see `brushexp.system.checkpoint`."""

from pathlib import Path

from brushexp.system.checkpoint import CheckpointFormat

RENDERERS = CheckpointFormat(
    noun="renderer",
    family="renderer",
    node="renderer",
    task="task=train",
    without="weights that are not trained",
    shipped=Path(__file__).parent / "weights",
)
