"""Test that paint skips the requested fraction of a paper at any size, and that every output file shows the paper."""

import io
from base64 import b64decode
from dataclasses import replace

import numpy as np
import pytest
import torch
from brushexp_media.paper import papers
from brushexp_media.paper.wetness import density_of_edges, gather_pigment
from brushexp_media.picture.noise import fractal_noise, map_to_uniform
from brushexp_testing.families import some_strokes
from PIL import Image
from torch.testing import assert_close

from brushexp.painting.reopen import export_job
from brushexp.plugins.paper.base import Rows
from brushexp.registry import build_named, plugins
from brushexp.shading.light import Light, overlay
from brushexp.strokes.saved import Saved

PAPERS = [plugin.name for plugin in plugins("paper") if not plugin.cls.is_smooth]
WET = {"granulation": 0.5, "rims": 3.0, "clean": 1.0, "blooms": 0.5, "wander": 0.5, "lost": 0.4, "charged": 0.5}
WHITE = torch.ones(3)


def covered(name: str, size: tuple[int, int], color: float = 0.2, **options):
    """Return the picture (3, H, W) of an even coat of paint on white paper."""
    return build_named("paper", name, options).cover(torch.full((3, *size), color), WHITE, Rows(0, size[0], size))


@pytest.mark.parametrize("name", PAPERS)
@pytest.mark.parametrize("tooth", [0.1, 0.25])
@pytest.mark.parametrize("drag", [0.0, 0.6])
def test_paint_skips_the_share_that_is_asked(name, tooth, drag):
    bare = (covered(name, (300, 400), tooth=tooth, grain=8, pressure=0, drag=drag) > 0.6).float().mean()
    assert float(bare) == pytest.approx(tooth, abs=0.06)
    assert_close(covered(name, (30, 40), tooth=0), torch.full((3, 30, 40), 0.2))


@pytest.mark.parametrize("name", PAPERS)
def test_a_paper_is_the_same_at_any_size(name):
    small, large = (covered(name, size, tooth=0.3, grain=60) for size in ((60, 80), (240, 320)))
    mean = torch.nn.functional.avg_pool2d(large, 4)
    assert float((mean - small).abs().mean()) < 0.25 * float((small - small.mean()).abs().mean())


def test_seeds_are_other_papers_and_the_same_seed_the_same():
    one, again, other = (covered("rough", (40, 60), seed=seed) for seed in (1, 1, 2))
    assert torch.equal(one, again)
    assert not torch.equal(one, other)


@pytest.mark.parametrize("name", PAPERS)
def test_gradients_pass_a_paper(name):
    generator = torch.Generator().manual_seed(0)
    flat = (0.1 + 0.6 * torch.rand(3, 4, 5, generator=generator, dtype=torch.float64)).requires_grad_()
    bare = torch.tensor([0.9, 0.95, 0.85], dtype=torch.float64, requires_grad=True)
    paper = build_named("paper", name, {"grain": 150.0, "tooth": 0.3, "granulation": 0.5, "blooms": 0.3})
    assert torch.autograd.gradcheck(lambda flat, bare: paper.cover(flat, bare, Rows(0, 4, (4, 5))), (flat, bare))


def test_noise_is_even_in_its_ranks_and_repeats_for_its_seed():
    x, y = torch.meshgrid(torch.arange(200) * 0.37, torch.arange(200) * 0.37, indexing="ij")
    rank = map_to_uniform(fractal_noise(x.double(), y.double(), 3))
    for share in (0.2, 0.5, 0.8):
        assert float((rank < share).float().mean()) == pytest.approx(share, abs=0.05)
    assert torch.equal(rank, map_to_uniform(fractal_noise(x.double(), y.double(), 3)))


def test_pigment_gathers_on_the_dark_side_of_an_edge():
    picture = torch.full((3, 20, 40), 0.9)
    picture[:, :, 20:] = 0.4
    density = density_of_edges(picture, 2.0)
    assert density[10].argmax() == 20
    assert float(density[10, 20]) > 0.1
    assert float(density[:, :20].max()) < 1e-6
    darker = gather_pigment(picture, density)
    assert bool((darker <= picture).all())
    assert torch.equal(gather_pigment(torch.ones(3, 2, 2), torch.ones(2, 2)), torch.ones(3, 2, 2))


def test_paper_is_what_strokes_that_skip_its_hollows_make(monkeypatch):
    """Paper agrees with a slow reference that makes each stroke skip the hollows before compositing it."""
    monkeypatch.setattr(papers, "STEEP", 1e9)  # every pixel has either full paint or none
    job = job_on("cold_pressed", grain=40.0, tooth=0.3)
    rows, bare = Rows(0, job.size[0], job.size), torch.tensor([0.8, 0.7, 0.3])
    hollow = job.paper.cover(torch.zeros(3, *job.size), WHITE, rows)[0].flatten()
    x, y = (max(job.size) * place.float().flatten() for place in rows.places)
    alpha, color = job.renderer(job.strokes).sample(torch.arange(30)[None], torch.stack([x, y], -1)[None])
    pictures = []
    for mask in (1 - hollow, torch.ones_like(hollow)):
        picture = bare.repeat(len(x), 1)
        for a, c in zip(alpha[0] * mask, color[0].expand(-1, len(x), -1), strict=True):
            picture = torch.lerp(picture, c, a[:, None])
        pictures.append(picture.T.reshape(3, *job.size))
    assert 0.2 < float(hollow.mean()) < 0.4
    assert_close(job.paper.cover(pictures[1], bare, rows), pictures[0], atol=1e-5, rtol=0)


def job_on(name: str, light: float = 0.0, **options):
    strokes = some_strokes(30, (56, 72), width=(0.1, 0.4))
    saved = Saved(strokes, torch.arange(30, dtype=torch.int32), (56, 72), WHITE, renderer="analytic")
    return replace(export_job(saved), paper=build_named("paper", name, options), light=Light(depth=light))


@pytest.mark.parametrize("light", [0.0, 1.0])
def test_every_form_of_a_painting_shows_its_paper(light, tmp_path):
    job = job_on("rough", light, grain=25.0, tooth=0.3, **WET)
    flat, painting = job.bare().picture(), job.picture()
    assert np.abs(flat.astype(float) - painting).mean() > 2
    again = job.picture(torch.from_numpy(flat).movedim(-1, 0) / 255)  # painted again with the finished colours
    assert np.abs(again.astype(float) - painting).max() <= 3
    (path,) = build_named("to", "png", {}).write(job, tmp_path)
    assert np.array_equal(np.asarray(Image.open(path)), painting)
    (path,) = build_named("to", "svg", {}).write(job, tmp_path)
    layer = path.read_text().partition('id="light"')[2].partition("base64,")[2].partition('"')[0]
    layer = np.asarray(Image.open(io.BytesIO(b64decode(layer)))).astype(float)
    shown = flat + (layer[..., :3] - flat) * layer[..., 3:] / 255
    assert np.abs(shown - painting).max() < 3


def test_a_layer_over_the_colours_gives_any_picture():
    random = np.random.default_rng(0)
    flat, finished = random.integers(0, 256, (2, 20, 30, 3), dtype=np.uint8)
    finished[:5], flat[5:9], finished[9:12] = flat[:5], 0, 255
    layer = overlay(flat, finished).astype(float)
    shown = flat + (layer[..., :3] - flat) * layer[..., 3:] / 255
    assert np.abs(shown - finished).max() <= 1.5
    assert layer[:5, :, 3].max() == 0


def test_relief_of_a_paper_scales_with_the_picture():
    paper = build_named("paper", "weave", {"grain": 60.0})
    small, large = (paper.relief(Rows(0, size[0], size)) for size in ((60, 80), (120, 160)))
    assert_close(float(large.std()), 2 * float(small.std()), rtol=0.1, atol=0)


def test_dust_half_fills_hollows_and_leaves_their_number():
    black, rows = torch.zeros(3, 80, 80), Rows(0, 80, (80, 80))
    crisp, dusty = (
        build_named("paper", "rough", {"grain": 20.0, "tooth": 0.3, "dust": dust}).cover(black, WHITE, rows)[0]
        for dust in (0.0, 1.0)
    )
    half = [float(((seen > 0.1) & (seen < 0.9)).float().mean()) for seen in (crisp, dusty)]
    assert half[1] > 1.5 * half[0]
    assert torch.equal(crisp > 0.5, dusty > 0.5 * (1 - papers.LEFT))


@pytest.mark.parametrize("axis", [0, 1])
def test_grain_is_drawn_out_along_strokes(axis):
    stripes = (0.3 + 0.2 * torch.sin(torch.arange(120) / 3)).expand(3, 120, 120)  # along y
    stripes, rows = (stripes if axis == 0 else stripes.mT), Rows(0, 120, (120, 120))
    paper = build_named("paper", "rough", {"grain": 20.0, "tooth": 0.4, "drag": 1.0, "pressure": 0.0})
    hollow = (paper.cover(stripes, torch.ones(3), rows) - paper.cover(stripes, torch.zeros(3), rows))[0]
    steps = [float((hollow - hollow.roll(4, side))[20:100, 20:100].abs().mean()) for side in (axis, 1 - axis)]
    assert steps[0] < 0.75 * steps[1]


def test_bands_of_drawn_out_grain_are_those_of_the_whole():
    flat, rows = torch.rand(3, 90, 60, generator=torch.Generator().manual_seed(0)), Rows(40, 10, (90, 60))
    wet = {"lost": 0.5, "charged": 0.5, "clean": 1.0}
    paper = build_named("paper", "rough", {"grain": 6.0, "tooth": 0.3, "drag": 0.6, "accents": 0.5} | wet)
    wide = rows.widened(paper.margin(rows.size))
    whole, band = (paper.cover(flat[:, r.top : r.top + r.count], WHITE, r) for r in (Rows(0, 90, (90, 60)), wide))
    assert_close(band[:, 40 - wide.top :][:, :10], whole[:, 40:50], atol=1e-4, rtol=0)


def test_edges_are_lost_where_paper_is_wet_and_crisp_elsewhere():
    picture, rows = torch.full((3, 300, 300), 0.9), Rows(0, 300, (300, 300))
    picture[:, :, 150:] = 0.3
    paper = build_named("paper", "cold_pressed", {"tooth": 0, "lost": 0.5, "grain": 4.0})
    soft = ((paper.cover(picture, WHITE, rows)[0] - picture[0]).abs() > 0.1).float().sum(1)
    assert 0.05 < float((soft > 2).float().mean()) < 0.7
    assert 0.5 < float((soft == 0).float().mean()) < 0.95


def test_a_wash_is_warmer_here_and_cooler_there_and_bare_paper_is_white():
    seen = covered("cold_pressed", (200, 300), color=0.5, tooth=0, charged=1.0)
    warmth = seen[0] - seen[2]
    assert 0.03 < float(warmth.std()) < 0.3
    assert abs(float(warmth.mean())) < 0.1
    assert torch.equal(covered("cold_pressed", (60, 80), color=1.0, tooth=0, charged=1.0), torch.ones(3, 60, 80))


def ground_through(color: float, ground: float, **options) -> torch.Tensor:
    """Measure the fraction (H, W), 0 to 1, of the ground that is visible through an even coat of paint."""
    paper, rows = build_named("paper", "rough", {"grain": 8.0, **options}), Rows(0, 200, (200, 300))
    seen = paper.cover(torch.full((3, 200, 300), color), torch.full((3,), ground), rows)[0]
    return (seen - color) / (ground - color)


def test_ground_is_seen_in_halftones_and_not_in_lights_and_darks():
    seen = {c: float(ground_through(c, 0.6, tooth=0.3, halftones=1.0).mean()) for c in (0.1, 0.55, 0.95)}
    assert seen[0.55] > 0.15
    assert max(seen[0.1], seen[0.95]) < 0.01
    even = [float(ground_through(c, 0.6, tooth=0.3).mean()) for c in (0.1, 0.55)]
    assert even[0] == pytest.approx(even[1], abs=0.02)
    assert even[0] > 0.2


def test_strokes_fray_out_within_the_border():
    crisp, frayed = (ground_through(0.2, 1.0, tooth=0.2, border=4.0, frayed=f)[60:140] for f in (0.0, 3.0))
    assert_close(crisp[:, 60:-60], frayed[:, 60:-60])
    near = [part[:, 18:40].mean() for part in (crisp, frayed)]  # beyond the border, which is 12 pixels wide
    assert near[1] > near[0] + 0.15


@pytest.mark.parametrize("name", PAPERS)
def test_paper_stays_bare_along_its_edges(name):
    painted = covered(name, (90, 120), tooth=0, border=10.0)[0]
    bare = painted == 1
    assert bool(bare[[2, -3]].all())
    assert bool(bare[:, [2, -3]].all())
    assert_close(painted[25:-25, 25:-25], torch.full((40, 70), 0.2))
    breadths = bare[:45].float().sum(0)[20:-20]
    assert 6 < float(breadths.mean()) < 18
    assert float(breadths.std()) > 0.3  # the edge looks hand-drawn
