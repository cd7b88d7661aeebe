"""Shipped plugins that others extend or build on."""

from brushexp.plugins.blend.dense import Dense, over
from brushexp.plugins.blend.tiled import Tiled
from brushexp.plugins.color.rgb import Rgb
from brushexp.plugins.density._rounds import CHANNELS, Rounds
from brushexp.plugins.density._worst_places import new_strokes
from brushexp.plugins.density.fixed import Fixed
from brushexp.plugins.density.traced import Traced
from brushexp.plugins.export._prints import CM, DPI, Compression, PrintExporter, Sheet, SheetExporter, over_white
from brushexp.plugins.export.svg import profile_of, soft_edge
from brushexp.plugins.init.layers import FAR_AWAY, InLayers
from brushexp.plugins.optimizer.torch import TorchOptim
from brushexp.plugins.order.area import Area
from brushexp.plugins.renderer.analytic import Analytic
from brushexp.plugins.renderer.textured import FADED, Textured, close_loop
from brushexp.plugins.sampler.whole import Whole

__all__ = [
    "CHANNELS",
    "CM",
    "DPI",
    "FADED",
    "FAR_AWAY",
    "Analytic",
    "Area",
    "Compression",
    "Dense",
    "Fixed",
    "InLayers",
    "PrintExporter",
    "Rgb",
    "Rounds",
    "Sheet",
    "SheetExporter",
    "Textured",
    "Tiled",
    "TorchOptim",
    "Traced",
    "Whole",
    "close_loop",
    "new_strokes",
    "over",
    "over_white",
    "profile_of",
    "soft_edge",
]
