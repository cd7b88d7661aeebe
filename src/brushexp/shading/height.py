"""How high the paint of a painting stands."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from brushexp.compositing.layers import Layers
from brushexp.compositing.profile import Profile
from brushexp.compositing.textured_profile import TexturedProfile
from brushexp.compositing.windows import Windows
from brushexp.plugins.export.base import ExportJob
from brushexp.plugins.renderer.base import Renderer
from brushexp.shading._brush import LEVELS, Brush, height_textures, level_of, plain_brush, thickness_of
from brushexp.strokes.bezier import half_width_of
from brushexp.strokes.catalogue import Strokes

FILM = 0.1  # how thick the paint is that a stroke leaves at most, in widths of a stroke as wide as is typical
CARRIED = 0.75  # share of the paint below that an opaque stroke carries away or levels
THIN = 0.5  # pixels: a stroke thinner than about twice this is drawn so thick, and lower
AT_ONCE = 256  # windows


def height_of(job: ExportJob) -> np.ndarray:
    """Height of the paint (H, W), float32, in pixels of the picture; the bare canvas is 0.

    Strokes are laid from the bottom to the top. Each carries away a share of the paint that it covers and adds its own,

        h <- h (1 - CARRIED a) + a t,

    with its opacity a at a pixel, 0 to 1, and the thickness t of its film there. That is at most ``FILM`` times the
    geometric mean of its width and the typical (median) one: a broader brush leaves thicker paint, but not so thick
    that the first broad strokes outdo what is painted over them. A picture twice as large has heights twice as large,
    and so the same slopes. All this is what a blend makes of strokes of opacity CARRIED a and "colour" t / CARRIED, so
    every blend computes it.

    Renderers say where their strokes cover and shine: with ``textured`` and networks t is higher where their bristles
    left more paint (`_brush.thickness_of`). Plain strokes get bristles, and ridges where a brush pushes paint aside,
    from textures drawn at random; a stroke's number decides which. Simulated heights are in data sets, but renderers
    learn colour and coverage only, so coverage stands for them.

    Source: Hertzmann, "Fast paint texture" (2002): strokes with textures of opacity and height are laid over each other
    as colours are. Differs: paint that is covered still shows in the surface, instead of each stroke's height standing
    alone, and the thickness depends on the brush.

    The picture is made in bands, so that memory is little more than that of the result.
    """
    height = np.empty(job.size, np.float32)
    renderer = Impasto(job.renderer, typical_width(job.strokes))
    for top, band in replace(job, renderer=renderer, background=torch.zeros_like(job.background)).bands():
        height[top : top + band.shape[1]] = band[0].cpu().numpy()
    return height


def typical_width(strokes: Strokes) -> float:
    """Median width of strokes in pixels; 0 without any."""
    return 2 * float(half_width_of(strokes).median()) if len(strokes) else 0.0


class Impasto(Renderer):
    """Strokes whose colour is the height of their paint: what a blend makes of them is the height of the painting.

    Args:
        renderer: draws the strokes.
        typical: width of a stroke in the painting, pixels.
    """

    def __init__(self, renderer: Renderer, typical: float) -> None:
        super().__init__()
        self.renderer = renderer
        self.typical = typical
        self._raised: tuple[Tensor | None, Brush | None] = (None, None)  # textures, and what has been made of them

    @property
    def at_once(self) -> int | None:  # type: ignore[override]
        """A quarter of what the renderer draws at once: what is made of it needs room as well."""
        return self.renderer.at_once and max(1, self.renderer.at_once // 4)

    def rows(self, strokes: Strokes) -> Tensor | None:
        return self.renderer.rows(strokes)

    def forward(self, strokes: Strokes, number: Tensor | None = None) -> Layers:
        number = torch.arange(len(strokes), device=strokes.position.device) if number is None else number
        layers = self.renderer(strokes, number)
        film = FILM * (self.typical * 2 * half_width_of(strokes)).sqrt()
        kinds: dict[type[Layers], Callable[..., Layers]] = {
            Profile: _plain,
            TexturedProfile: self._textured,
            Windows: _windows,
        }
        return kinds.get(type(layers), HeightLayers)(layers, film, number)

    def _textured(self, layers: TexturedProfile, film: Tensor, number: Tensor) -> TexturedProfile:
        known, brush = self._raised
        if brush is None or known is not layers.textures:
            brush = height_textures(layers.textures)
            self._raised = (layers.textures, brush)
        textures, _, cells = brush
        return replace(
            layers, textures=textures, cells=None if layers.cells is None else cells, **_as_layers(film, layers.opacity)
        )


@dataclass(frozen=True)
class HeightLayers(Layers):
    """Layers of a kind that is not known here, whose colour is the height of their paint.

    Attributes:
        layers: the N strokes as they are drawn.
        film: (N,) pixels, how thick their paint is at most.
        number: (N,) which stroke each one is.
    """

    per_stroke = ()

    layers: Layers
    film: Tensor
    number: Tensor

    @property
    def curve(self) -> Tensor:  # type: ignore[override]
        return self.layers.curve

    @property
    def reach(self) -> Tensor:  # type: ignore[override]
        return self.layers.reach

    @property
    def color(self) -> Tensor:  # type: ignore[override]
        return self.layers.color

    def sample(self, index: Tensor, points: Tensor) -> tuple[Tensor, Tensor]:
        alpha, color = self.layers.sample(index, points)
        light = (color - self.layers.color[index][:, :, None]).mean(-1)
        height = self.film[index][..., None] * thickness_of(alpha, light)
        return CARRIED * alpha, (height / CARRIED)[..., None].expand(*height.shape, 3)


def _as_layers(film: Tensor, opacity: Tensor) -> dict[str, Tensor]:
    """Colour and opacity with which a blend of full films computes heights."""
    return {"color": (film / CARRIED)[:, None].expand(-1, 3).contiguous(), "opacity": CARRIED * opacity}


def _plain(layers: Profile, film: Tensor, number: Tensor) -> TexturedProfile:
    """Strokes without a texture, with that of a brush."""
    textures, extent, cells = (part.to(film.device) for part in plain_brush(layers.taper))
    half = (layers.half_width.square() + THIN**2).sqrt()
    look = number % (len(textures) // LEVELS) * LEVELS + level_of(half)
    return TexturedProfile(
        curve=layers.curve,
        half_width=half,
        textures=textures,
        extent=extent.to(film.dtype),
        look=look,
        cells=cells,
        **_as_layers(film, layers.opacity * layers.half_width / half),
    )


def _windows(layers: Windows, film: Tensor, number: Tensor) -> Windows:
    """Drawn windows, whose colours are replaced by what their coverage and light say of the height."""
    images = []
    for image, color, full in zip(*(part.split(AT_ONCE) for part in (layers.images, layers.color, film)), strict=True):
        light = (image[:, :3] - color[:, :, None, None]).mean(1)
        height = thickness_of(image[:, 3], light) * (full / CARRIED)[:, None, None]
        images.append(torch.stack([height, height, height, image[:, 3]], dim=1))
    return replace(layers, images=torch.cat(images), opacity=CARRIED * layers.opacity)
