"""Tests of the style loss: against independent formulations, on parts of the canvas, and in paintings."""

from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image
from refusals import refuses
from torch import Tensor
from torch.testing import assert_close

from brushexp.painting.components import build_losses
from brushexp.pictures.color import recolor
from brushexp.pictures.load import load_picture
from brushexp.pictures.region import Region
from brushexp.plugins.loss.base import PaintedView, Surroundings, weighted_sum
from brushexp.plugins.loss.style import KERNELS, VARIANCE_OFFSET, Style
from brushexp.registry import build_named
from brushexp.strokes.catalogue import Strokes
from brushexp.tasks import paint

NONE = Strokes.none()
TAPS = ["stem", "b0"]  # small receptive fields, so small pictures suffice


def pictures(height: int = 40, width: int = 52, dtype: torch.dtype = torch.float32) -> tuple[Tensor, Tensor]:
    image, target = torch.rand(2, 3, height, width, generator=torch.Generator().manual_seed(3), dtype=dtype)
    return image, target


def saved(tmp_path: Path, picture: Tensor, name: str = "style.png") -> str:
    """Save a picture (3, H, W) with 8-bit colours, and return its path."""
    pixels = (picture * 255).round().to(torch.uint8).permute(1, 2, 0).numpy()
    Image.fromarray(pixels).save(tmp_path / name)
    return str(tmp_path / name)


def value_by_numpy(kernel: str, ours: np.ndarray, style: np.ndarray) -> float:
    """Compute one tap's loss with einsum, from features (C, P) of the picture and the style."""
    if kernel == "poly":
        a, b = (np.einsum("ip,jp->ij", f, f) / f.shape[1] for f in (ours, style))
        return float(((a - b) ** 2).sum() / np.einsum("ip,ip,jp,jp->", style, style, style, style) * style.shape[1])
    power = np.einsum("ip,ip->", style, style) / style.shape[1]
    parts = [(ours.mean(1) - style.mean(1)) ** 2]
    if kernel == "meanstd":
        a, b = (np.sqrt(f.var(1) + VARIANCE_OFFSET * power) for f in (ours, style))
        parts.append((a - b) ** 2)
    return float(np.sum(parts) / power)


@pytest.mark.parametrize("kernel", ["poly", "linear", "meanstd"])
def test_the_value_agrees_with_numpy(kernel):
    image, target = pictures(dtype=torch.float64)
    loss = Style(kernel=kernel, taps=["stem", "b2"]).double()
    ours, style = (loss.network(x[None], ["stem", "b2"]) for x in (image, target))
    expected = [
        value_by_numpy(kernel, *(result[tap][0].flatten(1).numpy() for result in (ours, style))) for tap in ours
    ]
    assert float(loss(PaintedView(image, target, NONE))) == pytest.approx(np.mean(expected), rel=1e-9)


def test_the_gaussian_kernel_agrees_with_all_pairs_of_positions():
    image, target = pictures(24, 32, dtype=torch.float64)
    loss = Style(kernel="gaussian", taps=["stem"]).double()
    a, b = (loss.network(x[None], ["stem"])["stem"][0].flatten(1).T for x in (image * 0.5, target))
    width = torch.cdist(b, b).median()

    def mean_kernel(x: Tensor, y: Tensor) -> float:
        return float(torch.exp(-torch.cdist(x, y).square() / (2 * width**2)).mean())

    exact = mean_kernel(a, a) + mean_kernel(b, b) - 2 * mean_kernel(a, b)
    assert float(loss(PaintedView(image * 0.5, target, NONE))) == pytest.approx(exact, rel=0.2)  # 256 random features


@pytest.mark.parametrize("kernel", KERNELS)
def test_the_style_picture_itself_costs_nothing(kernel, tmp_path):
    image, target = pictures()
    style = (image * 255).round() / 255
    loss = Style(image=saved(tmp_path, style), kernel=kernel, taps=TAPS)
    assert float(loss(PaintedView(style, target, NONE))) < 1e-10
    assert float(loss(PaintedView(target, target, NONE))) > 1e-5


@pytest.mark.parametrize(
    ("kernel", "size"), [("poly", (96, 123)), ("linear", (101, 90)), ("gaussian", (83, 80)), ("meanstd", (77, 98))]
)
def test_a_part_counts_as_in_the_whole(kernel, size, monkeypatch):
    """Loss and gradient on parts of a changing canvas match those of the whole, but for effects beyond the context."""
    monkeypatch.setattr("brushexp.features.base.TILE_PIXELS", 64)
    image, target = pictures(*size)
    loss, whole = Style(kernel=kernel), Style(kernel=kernel)
    picture = image.clone()
    places = [Region(30, 40, 33, 27), Region(0, 0, 20, 20), Region(size[0] - 25, size[1] - 18, 25, 18)]
    for region in [*places, Region(0, 0, *size)]:
        around = Surroundings(region, picture, target)
        for _ in range(2):
            patch = torch.rand(3, region.height, region.width).requires_grad_()
            region.of(picture).copy_(patch.detach())  # as the painter does, before the losses
            result, _ = weighted_sum({"style": loss}, PaintedView(patch, region.of(target), NONE, around))
            result.backward()
            full = picture.clone().requires_grad_()
            expected = whole(PaintedView(full, target, NONE))
            expected.backward()
            assert_close(result, expected, rtol=2e-2, atol=1e-5)
            slope = region.of(full.grad)
            assert (patch.grad - slope).norm() < 5e-2 * slope.norm()


def test_another_picture_or_a_step_on_the_whole_canvas_is_noticed():
    image, target = pictures(80, 90)
    loss, region = Style(taps=TAPS), Region(10, 20, 30, 30)

    def value(picture: Tensor) -> Tensor:
        around = Surroundings(region, picture, target)
        return weighted_sum({"style": loss}, PaintedView(region.of(picture), region.of(target), NONE, around))[0]

    value(image)
    result = value(image * 0.5)
    assert_close(result, Style(taps=TAPS)(PaintedView(image * 0.5, target, NONE)), rtol=1e-4, atol=1e-7)
    changing = image.clone()
    value(changing)
    changing *= 0.3
    loss(PaintedView(changing, target, NONE))
    assert_close(value(changing), Style(taps=TAPS)(PaintedView(changing, target, NONE)), rtol=1e-4, atol=1e-7)


def test_a_part_is_looked_at_with_memory_for_a_part(monkeypatch):
    monkeypatch.setattr("brushexp.features.base.TILE_PIXELS", 64)
    image, target = pictures(300, 310)
    loss, seen = Style(), []
    loss.network.register_forward_pre_hook(lambda _, inputs: seen.append(inputs[0].shape[-2:]))
    for region in (Region(100, 90, 40, 50), Region(200, 200, 40, 50)):
        around = Surroundings(region, image, target)
        weighted_sum({"style": loss}, PaintedView(region.of(image), region.of(target), NONE, around))
    assert max(max(shape) for shape in seen) <= 64 + 2 * loss.context + 2 * loss.grid


def test_what_cannot_serve_as_a_style_is_refused(tmp_path):
    refuses(r"loss.style.image=nowhere\.jpg is not there", build_named, "loss", "style", {"image": "nowhere.jpg"})
    refuses("choose from stem", Style, taps=["relu1_1"])
    small = Style(image=saved(tmp_path, torch.rand(3, 20, 80)))
    words = r"80 x 20 pixels at the scale 1 .* 32 x 32; set style\.loss\.scale=1\.6 or"
    refuses(words, small, PaintedView(*pictures(60, 80), NONE))
    enough = Style(image=small.image, scale=1.6)
    assert enough(PaintedView(*pictures(60, 80), NONE)).isfinite()


def moments(picture: Tensor) -> tuple[Tensor, Tensor]:
    colors = picture.flatten(1).double()
    return colors.mean(1), torch.cov(colors, correction=0)


def test_recolouring_takes_over_mean_and_covariance_also_of_the_target_if_asked(tmp_path):
    """A recoloured picture has the other picture's mean and covariance, as long as the colours are not clipped."""
    mix = torch.tensor([[0.1, 0.02, 0.0], [0.0, 0.05, 0.03], [0.02, 0.0, 0.08]])
    picture = 0.4 + 0.2 * (torch.rand(3, 40, 60) - 0.5)
    like = 0.5 + torch.einsum("ij,jhw->ihw", mix, torch.rand(3, 30, 20) - 0.5)
    result = recolor(picture, like)
    assert result.shape == picture.shape
    for ours, expected in zip(moments(result), moments(like), strict=True):
        assert_close(ours, expected, rtol=1e-3, atol=1e-6)
    assert_close(recolor(picture, picture), picture, rtol=0, atol=1e-6)
    style, (_, target) = saved(tmp_path, torch.rand(3, 50, 100)), pictures(80, 120)
    for scale, size in ((1.0, (60, 120)), (0.6, (36, 72)), (2.0, (120, 240))):
        assert Style(image=style, scale=scale, taps=TAPS).picture(target).shape[1:] == size
    picture = Style(image=style, colors="content").picture(0.5 * target)
    assert_close(picture, recolor(load_picture(style, 120), 0.5 * target))
    assert_close(moments(picture)[0], moments(0.5 * target)[0], rtol=0.02, atol=0)


@pytest.mark.parametrize("even", [0.0, 0.4, 1.0])
def test_recolouring_even_pictures_is_finite(even):
    flat, noise = torch.full((3, 8, 9), even), torch.rand(3, 7, 5)
    for picture, like in ((flat, noise), (noise, flat), (flat, flat), (noise[:, :1, :1], noise), (noise, noise * 0)):
        result = recolor(picture, like)
        assert result.isfinite().all()
        assert 0 <= result.min() <= result.max() <= 1
    assert_close(recolor(noise, flat).mean(), torch.tensor(even), rtol=0, atol=1e-5)
    nearly_even = even + 0.001 * torch.randn(3, 40, 40)
    assert recolor(nearly_even, torch.rand(3, 40, 40)).std() < 0.1, "noise is not blown up to colours"


@pytest.mark.parametrize("content", [0, 0.25])
def test_the_style_is_added_and_the_others_are_weakened(config, content):
    settings = ["style.image=coffee", "style.colors=content", "style.loss.kernel=meanstd", f"style.content={content}"]
    losses = build_losses(config(*settings, "loss=[mse,l1]", "loss.l1.weight=2"))
    assert list(losses) == ["mse", "l1", "style"]
    assert [loss.weight for loss in losses.values()] == [content, 2 * content, 1.0]
    assert (losses["style"].image, losses["style"].colors, losses["style"].kernel) == ("coffee", "content", "meanstd")
    assert list(build_losses(config())) == ["mse", "curvature"]


def test_a_picture_is_painted_in_the_style_and_colours_of_another_and_measured_by_every_kernel(
    run_task, tmp_path, monkeypatch
):
    settings = ["style=coffee", "resolution=110", "strokes=60", "steps=8", "threads=1", "frames=0", "report=false"]
    metrics = run_task(paint, *settings)
    style, photo = load_picture("coffee", 110), load_picture("astronaut", 110)
    used, target = (load_picture(f"{tmp_path}/{name}.png", None) for name in ("style", "target"))
    assert_close(used, style, rtol=0, atol=0.003)
    assert_close(target, recolor(photo, style), rtol=0, atol=0.003)
    assert "loss/style" in (tmp_path / "curves" / "metrics.csv").read_text()
    assert {key for key in metrics if key.startswith("style_")} == {f"style_{kernel}" for kernel in KERNELS}
    monkeypatch.setattr("brushexp.features.base.TILE_PIXELS", 32)
    image, target = pictures()
    loss = Style(kernel="linear")
    before = loss(PaintedView(image, target, NONE))
    for name, value in loss.measure(image, target).items():
        assert value == pytest.approx(float(Style(kernel=name)(PaintedView(image, target, NONE))), rel=1e-4)
    assert_close(loss(PaintedView(image, target, NONE)), before, rtol=0, atol=0)
