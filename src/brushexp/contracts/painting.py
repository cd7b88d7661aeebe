"""The parts of a painting, its optimisation and its result."""

from brushexp.painting.build import build_painter, clip_of, compute_focus, faces_of
from brushexp.painting.canvas_memory import boxes_of
from brushexp.painting.changes import build_changes
from brushexp.painting.components import (
    PIXELS_OF_A_STROKE,
    Components,
    Stage,
    build_components,
    build_stages,
    first_strokes,
    standard_components,
    stroke_budget,
)
from brushexp.painting.densification import importance
from brushexp.painting.finished import Finished, bare_job
from brushexp.painting.goals import goals_of
from brushexp.painting.metrics import measure, standard_metrics
from brushexp.painting.picture import Picture
from brushexp.painting.reopen import export_job, recorded_settings, with_renderer
from brushexp.painting.stroke_optimizer import StrokeOptimizer
from brushexp.painting.working_size import AUTO, sizes_of, working_side_for

__all__ = [
    "AUTO",
    "PIXELS_OF_A_STROKE",
    "Components",
    "Finished",
    "Picture",
    "Stage",
    "StrokeOptimizer",
    "bare_job",
    "boxes_of",
    "build_changes",
    "build_components",
    "build_painter",
    "build_stages",
    "clip_of",
    "compute_focus",
    "export_job",
    "faces_of",
    "first_strokes",
    "goals_of",
    "importance",
    "measure",
    "recorded_settings",
    "sizes_of",
    "standard_components",
    "standard_metrics",
    "stroke_budget",
    "with_renderer",
    "working_side_for",
]
