"""Tests of focus: its map, and how losses and strokes use it."""

import math
from pathlib import Path

import numpy as np
import pytest
import torch
from brushexp_policies.patches import Patches
from painters import painter_of as some_painter
from painters import take
from PIL import Image
from torch import Tensor
from torch.testing import assert_close

import brushexp
from brushexp.config.looks import look_names
from brushexp.errors import UserError
from brushexp.painting.build import compute_focus
from brushexp.painting.metrics import measure, standard_metrics
from brushexp.painting.stroke_optimizer import StrokeOptimizer
from brushexp.pictures.faces.detection import find_faces
from brushexp.pictures.focus import attention, focus_map, focus_weights, resample_weights, sharpness
from brushexp.pictures.load import load_picture, planes_of
from brushexp.pictures.similarity import dissimilarity, statistics
from brushexp.plugins.init.slic import Slic
from brushexp.plugins.loss.base import Loss, PaintedView
from brushexp.plugins.loss.l1 import MeanAbsoluteError
from brushexp.plugins.loss.mse import MeanSquaredError
from brushexp.plugins.loss.perceptual import Perceptual
from brushexp.plugins.loss.ssim import StructuralSimilarity
from brushexp.plugins.sampler.whole import Whole
from brushexp.registry import build_named
from brushexp.strokes.catalogue import Strokes
from brushexp.system.files import write_picture
from brushexp.tasks import paint

SIZE = (53, 78)


def mask_file(path: Path, pixels: np.ndarray) -> str:
    Image.fromarray(pixels).save(path)
    return str(path)


def scene(size: tuple[int, int] = SIZE, strength: float = 8) -> tuple[Tensor, Tensor, Tensor]:
    """Return a picture and its target, both in double precision, and focus weights."""
    generator = torch.Generator().manual_seed(7)
    image, target = torch.rand(2, 3, *size, generator=generator, dtype=torch.float64)
    return 0.7 * target + 0.3 * image, target, focus_weights(torch.rand(size, generator=generator) ** 3, strength)


def slope_of(loss: Loss, image: Tensor, target: Tensor, focus: Tensor | None) -> tuple[Tensor, Tensor]:
    image = image.detach().clone().requires_grad_()
    value = loss(PaintedView(image, target, Strokes.none(), focus=focus))
    (slope,) = torch.autograd.grad(value, image)
    return value.detach(), slope


def inside_of(attended: Tensor, top: float, bottom: float, left: float, right: float) -> float:
    """Return the ratio of the means inside and outside a box, whose edges are fractions of the picture's sides."""
    height, width = attended.shape
    box = torch.zeros(height, width, dtype=torch.bool)
    box[round(top * height) : round(bottom * height), round(left * width) : round(right * width)] = True
    return float(attended[box].mean() / attended[~box].mean())


ATTENDED = {  # top, bottom, left, right of her face; of the cup and its handle; of eyes and nose
    "astronaut": (0.08, 0.36, 0.32, 0.56),
    "coffee": (0.1, 0.8, 0.3, 0.75),
    "chelsea": (0.25, 0.85, 0.25, 0.8),
}


@pytest.mark.parametrize("name", ATTENDED)
def test_what_people_look_at_wins(name):
    picture = load_picture(name, 128)
    attended, box = focus_map("auto", picture, find_faces(picture)), ATTENDED[name]
    assert attended.dtype == torch.float32
    assert 0 <= float(attended.min()) <= 0.02
    assert 0.9 < float(attended.max()) <= 1
    assert inside_of(attended, *box) > 3
    y, x = divmod(int(attended.argmax()), attended.shape[1])
    assert box[0] < y / attended.shape[0] < box[1]
    assert box[2] < x / attended.shape[1] < box[3]


@pytest.mark.parametrize("size", [(1, 1), (1, 9), (2, 3), (40, 30), (300, 7)])
def test_every_picture_has_a_map_and_in_an_even_one_nothing_matters(size):
    for level in (0.0, 0.3, 1.0):
        assert torch.equal(attention(torch.full((3, *size), level), []), torch.zeros(size))
    attended = attention(torch.rand(3, *size), [])
    assert attended.shape == size
    assert attended.isfinite().all()
    assert 0 <= float(attended.min()) <= float(attended.max()) <= 1


def test_what_is_sharp_is_looked_at_and_what_is_blurred_is_not():
    picture = torch.full((3, 120, 240), 0.6)
    for left in range(8, 112, 16):
        picture[:, 20:100, left : left + 8] = 0.2
    half = picture[None, :, :, :120]
    picture[:, :, 120:] = torch.nn.functional.avg_pool2d(half, 41, 1, 20, count_include_pad=False)[0]
    sharp = sharpness(picture)
    assert sharp.shape == (120, 240)
    assert float(sharp[40:80, 30:90].mean()) > 0.5
    assert float(sharp[:, 160:].max()) < 0.05
    attended = attention(picture, ())
    assert float(attended[20:100, 10:100].mean()) > 3 * float(attended[20:100, 140:].mean())


@pytest.mark.parametrize("strength", [1, 1.5, 8, 1000])
def test_the_brightest_counts_so_many_times_the_darkest(strength):
    weights = focus_weights(torch.rand(31, 17).clamp(0.2, 0.7).sub(0.2).div(0.5), strength)
    assert weights.dtype == torch.float32
    assert float(weights.double().mean()) == pytest.approx(1, abs=1e-6)
    assert float(weights.max() / weights.min()) == pytest.approx(strength, rel=1e-5)
    for level in (0.0, 0.3, 1.0):
        assert (focus_weights(torch.full((33, 51), level), strength) == 1).all(), "an even mask is none"


def test_smaller_weights_have_the_same_mean():
    weights = focus_weights(torch.rand(6, 9), 8)
    assert float(resample_weights(weights, (4, 5)).mean()) == pytest.approx(1)
    assert resample_weights(weights, (6, 9)) is weights


def test_a_mask_is_read_as_grey_at_the_size_of_the_picture(tmp_path):
    pixels = np.zeros((20, 30, 3), np.uint8)
    pixels[5:10, 12:24] = (255, 255, 255)
    pixels[15:] = (0, 255, 0)
    target = torch.rand(3, 20, 30)
    exact = focus_map(mask_file(tmp_path / "mask.png", pixels), target)
    assert exact.dtype == torch.float32
    assert (exact[5:10, 12:24] == 1).all()
    assert (exact[:5] == 0).all()
    assert_close(exact[15:], torch.full((5, 30), 0.587))
    larger = focus_map(str(tmp_path / "mask.png"), torch.rand(3, 60, 90))
    assert larger.shape == (60, 90)
    assert float(larger[22, 54]) == pytest.approx(1, abs=0.05)
    assert 0 <= float(larger.min()) <= float(larger.max()) <= 1
    for mask, size in (((171, 256), (342, 512)), ((17, 25), (171, 256)), ((1, 1), (5, 9))):  # sides may be rounded
        assert focus_map(mask_file(tmp_path / "m.png", np.ones(mask, np.uint8)), torch.rand(3, *size)).shape == size


def test_masks_of_every_depth_and_none_where_they_are_transparent(tmp_path):
    layer = np.full((4, 8, 4), 255, np.uint8)
    layer[:, :4, 3], layer[:, 6:, 3] = 0, 51
    for pixels, row in (
        (layer, [0, 0, 0, 0, 1, 1, 0.2, 0.2]),
        (np.full((4, 8), 40000, np.uint16), [40000 / 65535] * 8),
        (np.zeros((4, 8), bool), [0.0] * 8),
    ):
        result = focus_map(mask_file(tmp_path / "mask.png", pixels), torch.rand(3, 4, 8))
        assert_close(result[0], torch.tensor(row))


def test_masks_that_do_not_fit_are_refused_in_one_line(tmp_path):
    target = torch.rand(3, 40, 60)
    mask_file(tmp_path / "turned.png", np.zeros((60, 40), np.uint8))
    (tmp_path / "empty.png").touch()
    (tmp_path / "words.png").write_text("no picture at all")
    reasons = {
        "empty.png": "is empty",
        "words.png": "is not a picture",
        "word.png": "is not there; did you mean .*words.png. give auto",
    }
    for name, reason in (reasons | {"turned.png": "has 40 x 60 pixels, the picture 60 x 40; give one with"}).items():
        with pytest.raises(UserError, match=rf"^focus=.*{name} {reason}.*$") as error:
            focus_map(str(tmp_path / name), target)
        assert "image=" not in str(error.value)


@pytest.mark.parametrize(("loss", "power"), [(MeanSquaredError(), 2), (MeanAbsoluteError(), 1)])
def test_gradients_of_pixels_are_weighted(loss, power):
    image, target, focus = scene((5, 8))
    x = image.clone().requires_grad_()
    expected = ((x - target).abs() ** power * focus).sum() / 120
    gradient = torch.autograd.grad(expected, x)
    assert_close(slope_of(loss, image, target, focus), (expected.detach(), *gradient))


def test_windows_count_by_their_middle_features_by_their_area_and_the_example_of_a_loss_by_its_pixels():
    image, target, focus = scene((32, 48))
    value, _ = slope_of(StructuralSimilarity(), image, target, focus)
    windows = dissimilarity(image, target, *statistics(target)).mean(0)
    assert float(value) == pytest.approx(float((windows * focus).mean()))
    loss = Perceptual(jitter=0, taps=["stem"]).double()
    value, _ = slope_of(loss, image, target, focus)
    ours, theirs = (loss.network(x[None], ["stem"])["stem"][0] for x in (image, target))
    cells = focus.reshape(16, 2, 24, 2).mean((1, 3)).double()
    assert float(value) == pytest.approx(float(((ours - theirs).square() * cells).mean()))
    image, target, _ = scene((6, 9))
    focus = torch.zeros(6, 9)
    focus[2, 3] = 54
    value, slope = slope_of(build_named("loss", "edges", {}), image, target, focus)
    assert float(value) > 0
    assert slope.abs().sum(0).gt(0).nonzero().tolist() == [[2, 3], [2, 4], [3, 3]]


CANVAS = (60, 90)


def painter_of(focus: Tensor | None, *, sampler=None, losses=None, init_focus: Tensor | None = None) -> StrokeOptimizer:
    target = load_picture("chelsea", CANVAS[1])
    strokes = Slic()(target, 80, torch.Generator().manual_seed(0), init_focus)
    chosen = {"sampler": sampler or Whole(), "losses": losses or {"mse": MeanSquaredError()}}
    return some_painter(strokes=strokes, target=target, steps=200, options={"focus": focus}, **chosen)


def painted(painter: StrokeOptimizer, steps: int) -> Tensor:
    take(painter, steps)
    return painter.draw_whole()


SQUARE = torch.zeros(CANVAS)
SQUARE[20:45, 30:65] = 1
FOCUSED = focus_weights(SQUARE, 8)


def test_a_focus_is_painted_better_and_the_rest_worse_as_strokes_begin_where_it_matters():
    counts = []
    for focus in (None, torch.ones(CANVAS), FOCUSED):
        x, y = painter_of(None, init_focus=focus).strokes().position.unbind(1)
        counts.append(int(((x >= 30) & (x < 65) & (y >= 20) & (y < 45)).sum()))
    assert counts[0] == counts[1]
    assert counts[2] > 1.4 * counts[0]

    def errors(painter: StrokeOptimizer) -> list[float]:
        squares = (painted(painter, 80) - painter.picture.target).square().mean(0)
        return [float(squares[SQUARE.eq(value)].mean()) for value in (1, 0)]

    (inside, outside), (better, worse) = errors(painter_of(None)), errors(painter_of(FOCUSED, init_focus=FOCUSED))
    assert 10 * math.log10(inside / better) > 1
    assert worse > outside


def test_a_painter_of_parts_shows_losses_their_part_of_the_focus():
    weights = focus_weights(torch.rand(CANVAS), 8)
    seen: list[PaintedView] = []

    class Spy(MeanSquaredError):
        def forward(self, painting):
            seen.append(painting)
            return super().forward(painting)

    painted(painter_of(weights, sampler=Patches(n_active=9, patch=24, steps_per_patch=2), losses={"spy": Spy()}), 4)
    for painting in seen:
        assert torch.equal(painting.surroundings.focus, weights)
        assert_close(painting.focus, painting.surroundings.region.of(weights))
    assert seen[1].focus is seen[2].focus  # the first call compiles the kernels
    assert seen[2].focus is not seen[3].focus


def test_the_keys_make_weights_and_leave_the_map_and_the_focused_psnr_weighs_errors_by_it(config, run_task, tmp_path):
    a, b = (np.random.default_rng(i).integers(0, 256, (12, 17, 3), dtype=np.uint8) for i in (1, 2))
    focus = focus_weights(torch.rand(12, 17), 8)
    squares = ((a.astype(float) - b) / 255) ** 2
    expected = -10 * math.log10((squares.mean(2) * focus.numpy()).sum() / focus.numpy().sum())
    metrics = standard_metrics()
    result = measure(metrics, a, b, focus=focus)
    assert result["psnr_focus"] == pytest.approx(expected)
    assert measure(metrics, a, a, focus=focus)["psnr_focus"] == math.inf
    assert "psnr_focus" not in measure(metrics, a, b)
    assert measure(metrics, a, b, focus=torch.ones(12, 17))["psnr_focus"] == pytest.approx(result["psnr"], abs=1e-4)
    target = load_picture("coffee", 64)
    assert compute_focus(config(), target) == (None, None)
    weights, attended = compute_focus(config("focus=auto", "focus_strength=4"), target)
    assert weights.shape == attended.shape == target.shape[1:]
    write_picture(tmp_path / "mask.png", attended.expand(3, -1, -1))
    again, _ = compute_focus(config(f"focus={tmp_path / 'mask.png'}", "focus_strength=4"), target)
    assert_close(again, weights, rtol=0, atol=0.01)
    chosen = ["image=chelsea", "resolution=48", "steps=3", "frames=0", "report=false", "device=cpu", "focus=auto"]
    assert run_task(paint, *chosen)["psnr_focus"] > 5
    with Image.open(tmp_path / "focus.png") as image:
        assert image.size == (48, 32)


def nearly_flat(level: float, size: tuple[int, int] = (64, 96)) -> Tensor:
    generator = torch.Generator().manual_seed(3)
    return (0.4 + level * torch.rand(3, *size, generator=generator, dtype=torch.float64)).float()


@pytest.mark.parametrize("level", [0, 1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2])
def test_a_picture_that_hardly_varies_has_no_face_and_a_map_without_a_peak_of_its_rounding(level):
    picture = nearly_flat(level)
    assert find_faces(picture) == []
    attended = focus_map("auto", picture)
    assert attended.isfinite().all()
    if level <= 1e-7:
        assert not attended.any()


@pytest.mark.parametrize("color", [(248, 94, 227), (1, 1, 1), (30, 30, 30), (255, 128, 3)])
@pytest.mark.parametrize(("size", "resolution"), [((339, 190), 300), ((120, 77), 256), ((600, 401), 97)])
def test_the_rounding_of_a_flat_picture_that_was_resampled_is_no_face(color, size, resolution):
    assert find_faces(planes_of(np.full((*size, 3), color, np.uint8), resolution)) == []


FLAT = {
    "black": np.zeros((48, 64, 3), np.uint8),
    "white": np.full((48, 64, 3), 255, np.uint8),
    "pink": np.full((48, 64, 3), (248, 94, 227), np.uint8),
    "nearly": nearly_flat(1e-6, (48, 64)),
    "hardly": nearly_flat(1e-3, (48, 64)),
    "one pixel": np.pad(np.full((1, 1, 3), 255, np.uint8), ((20, 27), (30, 33), (0, 0))),
    "nothing": np.zeros((48, 64, 4), np.uint8),
    "cut-out": np.pad(np.full((20, 20, 4), (30, 30, 30, 255), np.uint8), ((14, 14), (22, 22), (0, 0))),
    "speck": np.pad(np.full((1, 1, 4), 255, np.uint8), ((20, 27), (30, 33), (0, 0))),
}


@pytest.mark.slow
@pytest.mark.parametrize("look", look_names())
def test_every_look_paints_a_picture_of_almost_one_colour_with_any_focus(look):
    foci = [{}, {"focus": None}, {"focus": "auto"}, {"focus": np.full((48, 64), 0.5, np.float32)}]
    for number, picture in enumerate(FLAT.values()):
        options = foci[number % len(foci)] | ({"background": "transparent"} if picture.shape[-1] == 4 else {})
        painting = brushexp.paint(picture, look=look, strokes=30, steps=2, threads=1, **options)
        assert painting.image.shape == (48, 64, 3)
        assert math.isfinite(painting.metrics["l1"])
