"""Tests that measure a painting's brushwork, compare it with other brushwork, and transfer it to new strokes."""

import math
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from refusals import refuses
from scenes import leaves, random_strokes
from torch import Tensor
from torch.testing import assert_close

from brushexp.painting.components import build_components, first_strokes
from brushexp.pictures.region import Region
from brushexp.plugins.density.fixed import Fixed
from brushexp.plugins.loss.base import PaintedView, Surroundings
from brushexp.plugins.loss.brushwork import (
    MATCHED,
    MIN_STROKES,
    Brushwork,
    BrushworkTransfer,
    brushwork_of,
    distances,
    load_brushwork,
    measures_to_match,
    transport_cost,
    with_brushwork,
)
from brushexp.registry import build
from brushexp.results.stroke_table import measure_strokes
from brushexp.strokes.bezier import curve_of, length_of
from brushexp.strokes.catalogue import Strokes, check_strokes
from brushexp.strokes.measures import is_visible, pitch_of
from brushexp.strokes.storage import Saved, save_catalogue

SIZE = (60, 90)


def visible(n: int, seed: int = 0, size: tuple[int, int] = SIZE, dtype: torch.dtype = torch.float64) -> Strokes:
    made = random_strokes(n, size, seed=seed, width=(0.1, 0.3), dtype=dtype)
    return replace(made, opacity=0.5 + 0.5 * made.opacity)


def combed(n: int, angle: float = 0.3, dtype: torch.dtype = torch.float64) -> Strokes:
    """Make straight, parallel strokes that all have the same size."""
    made = visible(n, dtype=dtype)
    end = made.position.new_tensor([math.cos(angle), math.sin(angle)]).expand(n, 2)
    same = {"scale": torch.full_like(made.scale, 12), "width": torch.full_like(made.width, 0.2)}
    return replace(made, start=-0.5 * end, control=0 * end, end=0.5 * end, **same)


def saved_painting(path: Path, strokes: Strokes, size: tuple[int, int] = SIZE) -> Path:
    depth = torch.arange(len(strokes), dtype=torch.int32)
    save_catalogue(path, Saved(strokes, depth, size, torch.zeros(3), "analytic", "", 0, "seed: 0\n"))
    return path


def painting(strokes: Strokes, size: tuple[int, int] = SIZE) -> PaintedView:
    image = torch.zeros(3, *size, dtype=strokes.width.dtype)
    return PaintedView(image, image, strokes)


def loss_like(strokes: Strokes) -> BrushworkTransfer:
    loss = BrushworkTransfer()
    loss.reference = brushwork_of(strokes, SIZE)
    return loss


@pytest.mark.parametrize(("n", "m"), [(1, 1), (1, 7), (5, 5), (6, 4), (4, 12), (13, 9)])
def test_transport_cost_agrees_with_moving_grains_one_by_one(n, m):
    values, reference = torch.randn(2, n, dtype=torch.float64), torch.randn(2, m, dtype=torch.float64).sort(1).values
    expected = []
    for row, other in zip(values.tolist(), reference.tolist(), strict=True):
        fine = sorted(row * m), sorted(other * n)  # n m grains each
        expected.append(sum((a - b) ** 2 for a, b in zip(*fine, strict=True)) / (n * m))
    assert_close(transport_cost(values, reference), torch.tensor(expected, dtype=torch.float64))


def test_what_is_matched_is_what_is_analysed_and_zero_for_the_reference_itself():
    made = visible(25)
    table = measure_strokes(made, torch.arange(25), SIZE)
    pitch = pitch_of(made, SIZE)
    measured = measures_to_match(made, pitch)
    for row, name in zip(measured, MATCHED, strict=True):
        value = torch.from_numpy(getattr(table, name))
        assert_close(row, (value / pitch + 0.1).log() if name in ("length", "width") else value, rtol=1e-4, atol=1e-4)
    for made in (visible(64), combed(40)):
        assert float(loss_like(made)(painting(made[torch.randperm(len(made))]))) < 1e-12
    assert loss_like(combed(40))(painting(visible(40))).isfinite(), "equal strokes are no division by zero"


def test_brushwork_depends_neither_on_ends_nor_on_size_nor_on_strokes_that_cannot_be_seen():
    made = visible(50)
    first, turned = brushwork_of(made, SIZE), replace(made, start=made.end, end=made.start)
    for other in (brushwork_of(turned, SIZE), brushwork_of(made.moved(3.0), (180, 270))):
        for name in ("length", "width", "bend", "measures"):
            assert_close(getattr(other, name), getattr(first, name), rtol=1e-3, atol=1e-3)
        assert_close((2 * other.deviation).cos(), (2 * first.deviation).cos(), rtol=1e-3, atol=1e-3)
    made = visible(60)
    faint = replace(made, opacity=torch.where(torch.arange(60) < 20, 0.01, made.opacity))
    thin = replace(made, width=torch.where(torch.arange(60) < 20, 0.0, made.width))
    for some in (faint, thin):
        assert len(brushwork_of(some, SIZE)) == 40
    pitch = pitch_of(made, SIZE)
    assert int(is_visible(faint, pitch).sum()) == 40
    some = leaves(faint, torch.float64)
    distances(some, SIZE, brushwork_of(made, SIZE)).sum().backward()
    assert (some.end.grad[:20] == 0).all()
    assert (some.end.grad[20:] != 0).any()


def test_the_distance_grows_with_what_is_changed_on_the_canvas_and_not_on_the_part_a_step_looks_at():
    made = visible(64)
    reference = brushwork_of(made, SIZE)
    longer = replace(made, start=2 * made.start, control=2 * made.control, end=2 * made.end)
    wider, bent = replace(made, width=2 * made.width), replace(made, control=made.control + 0.5)
    for index, change in enumerate((longer, wider, bent, combed(64))):
        assert distances(change, SIZE, reference)[index] > 0.05, MATCHED[index]
    assert distances(made, (600, 900), reference)[0] > 1, "sizes are in pitches of the canvas"
    made, loss = visible(50), loss_like(visible(40, seed=1))
    whole = painting(made)
    region = Region(10, 20, 16, 24)
    part = region.of(whole.image)
    view = PaintedView(part, part, made, Surroundings(region, whole.image, whole.target))
    assert_close(loss(view), loss(whole), rtol=0, atol=0)


@pytest.mark.parametrize(("n", "m"), [(160, 80), (50, 80), (75, 60)])
def test_strokes_take_over_lengths_widths_and_bends_together(n, m):
    model = visible(2 * m, seed=1, dtype=torch.float32)
    long = torch.linalg.vector_norm(curve_of(model)[:, 2] - curve_of(model)[:, 0], dim=1) > 4
    reference = brushwork_of(model[long][:m], SIZE)
    before = visible(n, size=(80, 50), dtype=torch.float32)
    after = with_brushwork(before, reference, (80, 50), torch.Generator().manual_seed(0))
    check_strokes(after)
    for name in ("position", "scale", "color", "opacity"):
        assert torch.equal(getattr(after, name), getattr(before, name)), name
    measured = rows(brushwork_of(after, (80, 50)))
    expected = rows(reference)
    gap = torch.cdist(measured, expected)
    assert gap.amin(1).max() < 0.02, "every stroke is a stroke of the reference"
    used = torch.bincount(gap.argmin(1), minlength=m)
    assert used.max() - used.min() <= 1, "and all of them are used equally often"


def rows(brushwork: Brushwork) -> Tensor:
    return torch.cat([brushwork.length[:, None], brushwork.width[:, None], brushwork.bend.abs().clamp_max(5)], dim=1)


def test_directions_follow_the_picture_and_deviate_as_in_the_reference():
    before = combed(200, angle=0.7, dtype=torch.float32)
    model = visible(200, seed=1, dtype=torch.float32)
    reference = brushwork_of(model, SIZE)
    strict = replace(reference, deviation=0 * reference.deviation)
    generator = torch.Generator().manual_seed(0)
    along = with_brushwork(before, strict, SIZE, generator)
    chord = along.end - along.start
    assert_close(torch.atan2(chord[:, 1], chord[:, 0]).remainder(math.pi), torch.full((200,), 0.7), atol=1e-4, rtol=0)
    free = with_brushwork(before, reference, SIZE, generator)
    chord = free.end - free.start
    turned = torch.atan2(chord[:, 1], chord[:, 0]) - 0.7
    assert_close((2 * turned).cos().sort().values, (2 * reference.deviation).cos().sort().values, atol=1e-3, rtol=0)


def test_large_strokes_go_where_strokes_were_large_and_all_bend_with_the_flow():
    before = combed(300, dtype=torch.float32)
    large = torch.arange(300) < 100
    before = replace(before, width=torch.where(large, 0.4, 0.1))
    after = with_brushwork(before, brushwork_of(visible(90, dtype=torch.float32), SIZE), SIZE, torch.Generator())
    area = after.width * length_of(curve_of(after))
    assert area[large].min() > 0.5 * area[~large].max()
    assert area[large].mean() > 2 * area[~large].mean()
    generator = torch.Generator().manual_seed(1)
    angle = 2 * math.pi * torch.rand(400, generator=generator)
    radius = 15 + 30 * torch.rand(400, generator=generator)
    out = torch.stack([angle.cos(), angle.sin()], dim=1)
    tangent = torch.stack([-out[:, 1], out[:, 0]], dim=1)
    straight, position = combed(400, dtype=torch.float32), 50 + radius[:, None] * out
    before = replace(straight, position=position, start=-0.5 * tangent, end=0.5 * tangent)
    reference = brushwork_of(visible(80, dtype=torch.float32), SIZE)
    bend = torch.stack([torch.zeros(80), torch.full((80,), 0.2)], dim=1)
    reference = replace(reference, deviation=0 * reference.deviation, bend=bend)
    after = with_brushwork(before, reference, (100, 100), generator)
    outward = ((after.control - 0.5 * (after.start + after.end)) * out).sum(1)
    assert (outward > 0).float().mean() > 0.95


@pytest.mark.parametrize("n", [0, 1, 2, 20])
def test_hardly_any_strokes_and_points_can_be_given_brushwork(n):
    reference, before = brushwork_of(visible(40, dtype=torch.float32), SIZE), visible(n, dtype=torch.float32)
    point = replace(before, start=0 * before.start, control=0 * before.start, end=0 * before.start)
    for some in (before, point):
        made = with_brushwork(some, reference, SIZE, torch.Generator())
        assert len(made) == n
        check_strokes(made)


def test_catalogues_that_will_not_do_are_refused_with_the_key(tmp_path):
    few = saved_painting(tmp_path / "few.h5", visible(MIN_STROKES - 1, dtype=torch.float32))
    refuses(r"style.brushwork=.*few.h5: only 29 of 29 strokes .* painting of 30 strokes", load_brushwork, few)
    refuses(r"there is no file .*, loss\.brushwork\.catalogue=", BrushworkTransfer, catalogue=str(tmp_path / "none.h5"))
    words = r"there is no file .*, style\.brushwork="
    refuses(words, BrushworkTransfer, "style.brushwork", catalogue=str(tmp_path / "none.h5"))
    (tmp_path / "text.h5").write_text("no catalogue")
    refuses(r"text.h5: not an HDF5 file; .*style.brushwork=", load_brushwork, tmp_path / "text.h5")


def test_style_brushwork_draws_the_first_strokes_and_adds_the_loss_and_none_is_kept_that_has_no_time(config, tmp_path):
    path = saved_painting(tmp_path / "catalogue.h5", visible(60, dtype=torch.float32))
    cfg = config("strokes=60", f"style.brushwork={path}")
    target = torch.rand(3, 40, 56)
    losses = build_components(cfg).losses
    assert set(losses) == {"mse", "curvature", "brushwork"}
    plain = first_strokes(config("strokes=60"), target, Fixed(), None)[0]
    drawn = first_strokes(cfg, target, Fixed(), None)[0]
    before, after = (float(losses["brushwork"](painting(made, (40, 56)))) for made in (plain, drawn))
    assert after < 0.3 * before
    assert torch.equal(plain.position, drawn.position)
    target = torch.rand(3, 32, 32)
    for steps, first in ((2, 60), (500, 42)):
        cfg = config("density=adaptive", "strokes=60", f"steps_per_stroke={steps}")
        assert len(first_strokes(cfg, target, build(cfg.density), None)[0]) == first
