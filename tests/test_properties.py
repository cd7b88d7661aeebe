"""Tests of properties that hold for every scene, including those with degenerate strokes.

Stroke coordinates are dyadic (multiples of 1/64 pixel). A shift by whole tiles then gives kernels exactly the same
numbers, so the pictures match bit for bit.
"""

import os
from dataclasses import dataclass, replace

import pytest
import torch
from brushexp_policies.topk import TopK
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import leaves, random_strokes, straight
from torch import Tensor

from brushexp.compositing import bands
from brushexp.compositing.tile_lists import TILE, tile_lists
from brushexp.plugins.blend.base import Blend
from brushexp.plugins.blend.dense import Dense
from brushexp.plugins.blend.tiled import Tiled
from brushexp.plugins.renderer.analytic import Analytic
from brushexp.plugins.renderer.base import Renderer
from brushexp.plugins.renderer.textured import Textured
from brushexp.strokes.catalogue import FIELDS, Strokes

BACKGROUND = torch.tensor([0.25, 0.5, 0.875])
ROUNDING = 3e-6  # of sums in single precision
MOVED = 1e-4  # tolerance when coordinates are rounded elsewhere on the canvas
BLENDS: dict[str, Blend] = {
    "dense": Dense(),
    "tiled": Tiled(),
    "tiled, all strokes": Tiled(opaque=0.0),
    "tiled in torch": Tiled(opaque=0.0, kernel="torch"),
    "topk": TopK(k=3),
}
COMPILED = ("tiled", "tiled, all strokes")
RENDERERS: dict[str, Renderer] = {
    "analytic": Analytic(),
    "analytic, tapered": Analytic(taper=0.5, soft=0.75),
    "textured": Textured(checkpoint=None).requires_grad_(False),
}
KINDS = ("plain", "opaque", "transparent", "no width", "a point", "folded", "huge", "tiny", "off the canvas", "a copy")


@dataclass(frozen=True)
class Scene:
    """Strokes in front-to-back order on a canvas of ``size`` (H, W)."""

    strokes: Strokes
    size: tuple[int, int]

    def paint(self, blend: str, renderer: str, strokes: Strokes | None = None) -> Tensor:
        strokes = self.strokes if strokes is None else strokes
        order, background = torch.arange(len(strokes)), BACKGROUND.to(strokes.width)
        return BLENDS[blend](RENDERERS[renderer](strokes), order, self.size, background).image


def degenerate(strokes: Strokes, i: int, kind: str) -> Strokes:
    """Return the strokes with stroke ``i`` changed to one of ``KINDS``."""
    fields: dict[str, dict[str, object]] = {
        "plain": {},
        "opaque": {"opacity": 1.0, "width": 0.5},
        "transparent": {"opacity": 0.0},
        "no width": {"width": 0.0},
        "a point": {"start": strokes.end[i], "control": strokes.end[i]},
        "folded": {"end": strokes.start[i]},
        "huge": {"scale": 4096.0, "width": 0.25},
        "tiny": {"scale": 2.0**-6},
        "off the canvas": {"position": -5000.0},
        "a copy": {name: getattr(strokes, name)[max(i - 1, 0)] for name in FIELDS},
    }
    changed = strokes.map(Tensor.clone)
    for name, value in fields[kind].items():
        getattr(changed, name)[i] = torch.as_tensor(value)
    return changed


@st.composite
def scenes(draw: st.DrawFn, most: int = 10, bend: float = 0.15) -> Scene:
    """Draw random dyadic scenes; with the default bend, no pixel is equally near to two points of the same stroke."""
    size = (draw(st.integers(1, 26)), draw(st.integers(1, 26)))
    kinds = draw(st.lists(st.sampled_from(KINDS), max_size=most))
    strokes = random_strokes(len(kinds), size, seed=draw(st.integers(0, 10_000)), bend=bend, width=(0.02, 0.4))
    strokes = strokes.map(lambda value: (value * 64).round() / 64)
    for i, kind in enumerate(kinds):
        strokes = degenerate(strokes, i, kind)
    return Scene(strokes, size)


def assert_same(image: Tensor, expected: Tensor, exactly: bool, atol: float) -> None:
    if exactly:
        assert torch.equal(image, expected), f"off by {(image - expected).abs().max():.2g}"
    else:
        torch.testing.assert_close(image, expected, atol=atol, rtol=0)


def slack(blend: str) -> float:
    """Return the tolerance for comparing pictures whose tiles start at different pixels."""
    return MOVED + 2 * getattr(BLENDS[blend], "opaque", 0.0)


def inserted(strokes: Strokes, place: int, other: Strokes) -> Strokes:
    """Insert the strokes ``other`` before the stroke at index ``place``."""
    return Strokes.join(strokes[:place], other, strokes[place:])


EXAMPLES = int(os.environ.get("BRUSHEXP_SCENES", "8"))  # use hundreds to search
PROFILE = settings(max_examples=EXAMPLES, deadline=None, derandomize=True)
over_blends = pytest.mark.parametrize("blend", BLENDS)
over_renderers = pytest.mark.parametrize("renderer", RENDERERS)


def over_all(**strategies):
    """Run a test on random examples, for every blend and every renderer."""
    return lambda test: over_renderers(over_blends(PROFILE(given(**strategies)(test))))


@over_all(scene=scenes(bend=1.0), seed=st.integers(0, 100))
def test_pictures_lie_in_range_and_gradients_are_finite(blend, renderer, scene, seed):
    strokes = leaves(scene.strokes)
    image = scene.paint(blend, renderer, strokes)
    assert image.shape == (3, *scene.size)
    assert -ROUNDING <= image.min() <= image.max() <= 1 + ROUNDING
    (image * torch.randn(image.shape, generator=torch.Generator().manual_seed(seed))).sum().backward()
    for name, value in strokes.items():
        assert value.grad is None or value.grad.isfinite().all(), name


@over_renderers
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@PROFILE
@given(scene=scenes(bend=1.0))
def test_alpha_lies_between_nothing_and_the_opacity(dtype, renderer, scene):
    strokes = scene.strokes.map(lambda value: value.to(dtype))
    layers = RENDERERS[renderer](strokes)
    y, x = torch.meshgrid(*(torch.arange(n).to(dtype) + 0.5 for n in scene.size), indexing="ij")
    alpha, color = layers.sample(torch.arange(len(strokes))[None], torch.stack([x, y], -1).reshape(1, -1, 2))
    assert (alpha >= 0).all()
    assert (alpha <= strokes.opacity[:, None] + ROUNDING).all()
    assert ((color >= -ROUNDING) & (color <= 1 + ROUNDING)).all()


@over_all(seed=st.integers(0, 10_000), rows=st.integers(1, 3), columns=st.integers(1, 4))
def test_strokes_that_do_not_meet_may_come_in_any_order(blend, renderer, seed, rows, columns):
    n, cell = rows * columns, 11
    grid = torch.stack(torch.meshgrid(torch.arange(columns), torch.arange(rows), indexing="xy"), -1).reshape(-1, 2)
    strokes = random_strokes(n, (1, 1), seed=seed, bend=0.1, width=(0.02, 0.12))
    strokes = replace(strokes, position=grid * cell + 0.5 * cell, scale=torch.full((n,), 6.0))
    scene = Scene(strokes, (rows * cell, columns * cell))
    layers = RENDERERS[renderer](strokes)
    shuffled = torch.randperm(n, generator=torch.Generator().manual_seed(seed))
    one, other = (BLENDS[blend](layers, order, scene.size, BACKGROUND).image for order in (torch.arange(n), shuffled))
    assert torch.equal(one, other), "where one alpha is not 0, all others are"


@over_all(scene=scenes(), right=st.integers(0, 40), down=st.integers(0, 40), tiles=st.booleans())
def test_a_shift_by_whole_pixels_shifts_the_picture(blend, renderer, scene, right, down, tiles):
    """Compiled kernels are exact for shifts by multiples of eight pixels; other pictures may differ by `slack`."""
    right, down = (8 * (right // 8), 8 * (down // 8)) if tiles else (right, down)
    expected = scene.paint(blend, renderer)
    wide = replace(scene, size=(scene.size[0] + down, scene.size[1] + right))
    image = wide.paint(blend, renderer, scene.strokes.moved(shift=(right, down)))
    assert_same(image[:, down:, right:], expected, blend in COMPILED and tiles, slack(blend))


@over_all(
    scene=scenes(),
    place=st.integers(0, 10),
    kind=st.sampled_from(["transparent", "no width", "off the canvas", "far off", "beside"]),
    seed=st.integers(0, 100),
)
def test_strokes_that_cannot_be_seen_change_nothing(blend, renderer, scene, place, kind, seed):
    other = random_strokes(1, scene.size, seed=seed)
    if kind == "far off":
        other = replace(other, position=torch.tensor([[1e6, -1e6]]))
    elif kind == "beside":  # starts a pixel and a half beyond the right edge
        other = straight((scene.size[1] + 3.0, 0.0), (scene.size[1] + 3.0, scene.size[0]), width=1.0)
    else:
        other = degenerate(other, 0, kind)
    expected = scene.paint(blend, renderer)
    brushes = list(range(len(scene.strokes)))
    brushes.insert(place, len(brushes))
    strokes = replace(inserted(scene.strokes, place, other), brush=torch.tensor(brushes))
    image = BLENDS[blend](RENDERERS[renderer](strokes), torch.arange(len(brushes)), scene.size, BACKGROUND).image
    assert_same(image, expected, blend in COMPILED, ROUNDING)


@pytest.mark.parametrize("renderer", ["analytic", "analytic, tapered"])
@over_blends
@PROFILE
@given(scene=scenes(), place=st.integers(0, 10), seed=st.integers(0, 100))
def test_what_lies_below_an_opaque_stroke_changes_nothing_and_has_no_slope(blend, renderer, scene, place, seed):
    height, width = scene.size
    cover = straight((width / 2 - 10, height / 2), (width / 2 + 10, height / 2), width=16.0)
    hidden = random_strokes(1, scene.size, seed=seed, bend=0.1, width=(0.0, 0.2))
    hidden = replace(hidden, position=torch.tensor([[width / 2, height / 2]]), scale=torch.tensor([4.0]))
    without = inserted(scene.strokes, place, cover)
    expected = scene.paint(blend, renderer, without)
    number = min(min(place, len(scene.strokes)) + 1 + seed % 3, len(without))
    strokes = leaves(inserted(without, number, hidden))
    image = scene.paint(blend, renderer, strokes)
    assert_same(image.detach(), expected, blend in COMPILED, ROUNDING)
    (image * torch.randn(image.shape, generator=torch.Generator().manual_seed(seed))).sum().backward()
    assert all(value.grad[number].abs().max() == 0 for _, value in strokes.items())


@over_all(scene=scenes(), rows=st.integers(1, 30), tiles=st.booleans())
def test_bands_of_a_picture_are_the_picture(blend, renderer, scene, rows, tiles):
    rows = 8 * -(-rows // 8) if tiles else rows
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(bands, "BAND", rows * scene.size[1])
        order = torch.arange(len(scene.strokes))
        parts = list(bands.bands(scene.strokes, order, scene.size, BACKGROUND, RENDERERS[renderer], BLENDS[blend]))
    assert [top for top, _ in parts] == list(range(0, scene.size[0], rows))
    expected = scene.paint(blend, renderer)
    assert_same(torch.cat([part for _, part in parts], 1), expected, blend in COMPILED and tiles, slack(blend))


@pytest.mark.parametrize("taper", [0.0, 0.5])
@over_blends
@PROFILE
@given(scene=scenes(), zoom=st.sampled_from([3, 5]))
def test_a_larger_picture_shows_the_same_at_the_centres_of_the_old_pixels(blend, taper, scene, zoom):
    """Pixel i of the small picture equals pixel zoom * i + zoom // 2 of the large one, which has the same centre."""
    order, size = torch.arange(len(scene.strokes)), tuple(zoom * side for side in scene.size)
    expected = BLENDS[blend](Analytic(soft=1.5, taper=taper)(scene.strokes), order, scene.size, BACKGROUND).image
    layers = Analytic(soft=1.5 * zoom, taper=taper)(scene.strokes.moved(zoom=zoom))
    image = BLENDS[blend](layers, order, size, BACKGROUND).image[:, zoom // 2 :: zoom, zoom // 2 :: zoom]
    torch.testing.assert_close(image, expected, atol=slack(blend), rtol=0)


def test_a_pair_is_listed_if_and_almost_only_if_the_stroke_reaches_a_pixel_of_the_tile():
    size = (72, 110)
    strokes = random_strokes(400, size, seed=3)
    layers = Analytic()(strokes)
    lists = tile_lists(layers.curve, layers.reach, torch.arange(len(layers.reach)), size)
    rows, columns = lists.shape
    listed = torch.zeros(rows * columns, 400, dtype=torch.bool)
    for tile in range(rows * columns):
        listed[tile, torch.from_numpy(lists.stroke[lists.first[tile] : lists.first[tile + 1]]).long()] = True
    pixel, tile = torch.arange(TILE * TILE), torch.arange(rows * columns)[:, None]
    points = torch.stack([tile % columns * TILE + pixel % TILE, tile // columns * TILE + pixel // TILE], -1) + 0.5
    opaque = replace(layers, opacity=torch.ones(400))
    alpha, _ = opaque.sample(torch.arange(400).expand(rows * columns, -1), points)
    covers = (alpha > 1e-6).any(-1)
    assert listed[covers].all(), "nothing that can be seen is left out"
    assert covers.sum() > 0.9 * listed.sum()
