"""The interface of each plugin family: its base class, and the types that its methods take and return."""

from brushexp.plugins.blend.base import Blend, Compositor, match_dtype, pixel_centres
from brushexp.plugins.callbacks.base import Callback
from brushexp.plugins.change.base import Change, PaintingState
from brushexp.plugins.color.base import ColorSpace
from brushexp.plugins.density.base import DensificationState, DensificationUpdate, Density
from brushexp.plugins.engine.base import Engine, Simulated
from brushexp.plugins.export.base import Exporter, ExportJob
from brushexp.plugins.init.base import Initializer
from brushexp.plugins.logger.base import Logger, Run
from brushexp.plugins.loss.base import Loss, PaintedView, Surroundings, restore, state_of, weighted_sum
from brushexp.plugins.metric.base import Comparison, Metric
from brushexp.plugins.optimizer.base import Optimizer
from brushexp.plugins.order.base import ONCE, RENEWED_SHARE, Order, front_to_back
from brushexp.plugins.painter.base import Painter, PaintRequest, PaintState
from brushexp.plugins.palette.base import Palette
from brushexp.plugins.paper.base import Paper, Rows
from brushexp.plugins.renderer.base import (
    PRECISIONS,
    RENDERERS,
    TEXELS,
    PatchRenderer,
    Renderer,
    reach_of,
    window_pictures,
)
from brushexp.plugins.sampler.base import Sampler, View

__all__ = [
    "ONCE",
    "PRECISIONS",
    "RENDERERS",
    "RENEWED_SHARE",
    "TEXELS",
    "Blend",
    "Callback",
    "Change",
    "ColorSpace",
    "Comparison",
    "Compositor",
    "DensificationState",
    "DensificationUpdate",
    "Density",
    "Engine",
    "ExportJob",
    "Exporter",
    "Initializer",
    "Logger",
    "Loss",
    "Metric",
    "Optimizer",
    "Order",
    "PaintRequest",
    "PaintState",
    "PaintedView",
    "Painter",
    "PaintingState",
    "Palette",
    "Paper",
    "PatchRenderer",
    "Renderer",
    "Rows",
    "Run",
    "Sampler",
    "Simulated",
    "Surroundings",
    "View",
    "front_to_back",
    "match_dtype",
    "pixel_centres",
    "reach_of",
    "restore",
    "state_of",
    "weighted_sum",
    "window_pictures",
]
