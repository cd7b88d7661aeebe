"""Test that coded strokes are decoded bit-identically, and that the decoded painting has the requested PSNR."""

import zlib
from base64 import b64decode
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import torch
from brushexp_coding import entropy
from brushexp_coding.entropy import LARGEST, Decoder
from brushexp_coding.export import Bits
from brushexp_coding.file import HEAD, MAGIC, SIZES, VERSION, file_of, read_bits, read_rounded
from brushexp_coding.fitting import Canvas, code, mean_square
from brushexp_coding.metric import BitsPerPixel
from brushexp_coding.ordering import neighbouring_order
from brushexp_coding.residuals import BEFORE, nearest_before, residuals_of, restore_numbers, rgb_to_ycocg, ycocg_to_rgb
from brushexp_coding.rounding import (
    LADDER,
    MAX_COARSENESS,
    WINDOW_COLUMNS,
    Column,
    Rounded,
    orient_right,
    rung_near,
    strokes_of,
    values_of,
)
from brushexp_coding.streams import Reader, Writer
from catalogues import catalogue, changed, job_of
from hypothesis import given, settings
from hypothesis import strategies as st
from refusals import refusal, refuses
from scenes import random_strokes, with_shapes

from brushexp.painting.reopen import export_job
from brushexp.pictures.similarity import picture_psnr, psnr_of
from brushexp.plugins.metric.base import Comparison
from brushexp.plugins.renderer.analytic import Analytic
from brushexp.registry import build_named
from brushexp.strokes.catalogue import FIELDS, Strokes
from brushexp.strokes.storage import load_catalogue

CANVAS = (48, 64)
COUNT = len(Column) - len(WINDOW_COLUMNS)
numbers = st.integers(1 - LARGEST // 2, LARGEST // 2 - 1) | st.integers(-300, 300) | st.just(0)
groups = st.lists(st.lists(numbers, max_size=40).map(lambda group: np.array(group, np.int64)), max_size=6)


def painting(count: int = 40, **options):
    return job_of(with_shapes(random_strokes(count, CANVAS)), CANVAS, **options)


@given(groups)
@settings(max_examples=60, deadline=None)
def test_coded_numbers_come_back_to_the_bit(parts):
    coded = [(entropy.fit(part), part) for part in parts]
    decoder = Decoder(entropy.encode(coded))
    for distribution, part in coded:
        assert entropy.Distribution.unpack(distribution.pack()) == distribution
        assert np.array_equal(decoder.decode(distribution, len(part)), part)


@given(st.lists(st.integers(-(2**62), 2**62)), groups)
@settings(max_examples=40, deadline=None)
def test_streams_come_back_to_the_bit(described, parts):
    writer = Writer()
    classes = [np.arange(len(part)) % 3 for part in parts]
    for number in described:
        writer.write(number)
    for part, own in zip(parts, classes, strict=True):
        writer.write_column(part, own)
    reader = Reader(writer.to_bytes())
    assert [reader.read() for _ in described] == described
    assert all(np.array_equal(reader.read_column(own), part) for part, own in zip(parts, classes, strict=True))


def test_a_fitted_distribution_codes_at_about_the_entropy_of_what_it_was_fitted_to():
    generator = np.random.default_rng(0)
    for spread in (0.4, 3, 40, 3e5):
        drawn = np.rint(generator.normal(0, spread, 4000)).astype(np.int64)
        fitted = entropy.fit(drawn)
        _, counts = np.unique(drawn, return_counts=True)
        bits = 8 * len(entropy.encode([(fitted, drawn)])) / len(drawn)
        assert bits == pytest.approx(entropy.bits_of(fitted, drawn) / len(drawn), abs=0.02)
        gaussian = max(0.5 * np.log2(2 * np.pi * np.e * spread**2), -(counts / 4000 * np.log2(counts / 4000)).sum())
        assert bits < gaussian + 0.15


def rounded_strokes(count, seed, *, windows=False, brushes=False, spread=200.0):
    generator = np.random.default_rng(seed)
    columns = len(Column) if windows else COUNT
    values = generator.standard_t(2, (count, columns)) * spread
    values[:, generator.random(columns) < 0.2] = 0
    coarseness = generator.integers(-MAX_COARSENESS, MAX_COARSENESS + 1, (count, 2))
    rungs = generator.integers(0, 256, columns)
    own = generator.integers(0, 2**31, count) if brushes else None
    whole = values.clip(1 - LARGEST // 2, LARGEST // 2 - 1).astype(np.int64)
    rungs[(whole == 0).all(0)] = 0  # the file omits the steps of empty columns
    return Rounded(whole, coarseness, rungs, windows, own)


@given(
    st.sampled_from([0, 1, 2, 30, 450]), st.integers(0, 99), st.booleans(), st.booleans(),
    st.sampled_from([0.1, 5.0, 1e4, 1e14]),
)  # fmt: skip
@settings(max_examples=15, deadline=None)
def test_a_file_holds_what_is_coded_to_the_bit(count, seed, windows, brushes, spread):
    coded, saved = rounded_strokes(count, seed, windows=windows, brushes=brushes, spread=spread), catalogue()
    found, (size, background, about) = read_rounded(file_of(coded, saved))
    for name in ("numbers", "coarseness", "rungs"):
        assert np.array_equal(getattr(found, name), getattr(coded, name)), name
    assert (found.windows, found.brushes is None) == (windows, not brushes)
    assert not brushes or np.array_equal(found.brushes, coded.brushes)
    assert (size, about["renderer"], about["seed"]) == (saved.size, "analytic", 3)
    assert torch.allclose(background, saved.background, atol=1e-5)
    read_bits(file_of(coded, saved)).check()


# Three strokes written by version 1, which must stay readable on every machine.
OLDEST = (
    "QlhTVAEvDPt+AwAAADAAAABAAAAA//8AAACAAIAAgAgAAAAAAKumQqAo1QIANT8/Pz4+OTg1MzMzNzQ0NEgAAAACsgUA9gUCAErE"
    "D0jEBwIAAbIFAAAE8gQAtAcAAAD0BgDwAwAABvYFAgAAsgUAAgKyBQr4BgK2BgAAALIFAAAA9gQAsAMB8ANcqJrVHwrBJEYReQnN"
    "rS6kNff02buo3a4="
)


def test_a_file_of_the_first_version_is_read():
    strokes = read_bits(b64decode(OLDEST)).check().strokes
    middles = values_of(strokes, windows=False)[:, Column.MIDDLE_X : Column.MIDDLE_Y + 1]
    assert middles.round(decimals=2).tolist() == OLDEST_MIDDLES


OLDEST_MIDDLES = [[-11.88, 6.0], [10.09, 24.0], [47.8, 44.37]]


def test_weights_are_the_same_everywhere():
    kinds = [(2, 0, 0), (9, 2, 3), (15, 3, 7)]
    assert [zlib.crc32(entropy.weights_of(*kind).astype("<f8").tobytes()) for kind in kinds] == [
        1530546572,
        3090014252,
        3479078679,
    ]


@pytest.mark.parametrize("count", [0, 1, 3, BEFORE + 40])
def test_the_nearest_of_the_strokes_before_is_that_of_a_plain_search(count):
    middle = np.random.default_rng(count).integers(0, 12, (count, 2)).astype(float)
    found = nearest_before(middle)
    for stroke in range(1, count):
        first = max(0, stroke - BEFORE)
        distance = ((middle[first:stroke] - middle[stroke]) ** 2).sum(1)
        assert found[stroke] == first + max(np.nonzero(distance == distance.min())[0])


@given(st.integers(0, 50), st.integers(0, 999), st.booleans())
@settings(max_examples=40, deadline=None)
def test_differences_from_earlier_strokes_come_back_to_the_bit(count, seed, turned):
    generator = np.random.default_rng(seed)
    whole = generator.integers(1 - LARGEST // 2, LARGEST // 2, (count, 3)) >> generator.integers(0, 40)
    octaves = generator.integers(-MAX_COARSENESS, MAX_COARSENESS + 1, (count, 3))
    source = np.array([generator.integers(0, stroke) if stroke else 0 for stroke in range(count)], np.int64)
    residuals = residuals_of(whole, octaves, source)
    residuals = ycocg_to_rgb(rgb_to_ycocg(residuals)) if turned else residuals
    assert np.array_equal(restore_numbers(residuals, octaves, source), whole)


def test_the_ladder_of_steps_has_four_in_an_octave_and_the_nearest_is_no_larger():
    steps = LADDER.tolist()
    assert steps == sorted(steps)
    assert len(steps) == 256
    assert all(1.15 < high / low < 1.22 for low, high in pairwise(steps))
    assert [rung_near(step) for step in steps] == list(range(256))
    assert rung_near(0.0) == 0
    assert rung_near(1e30) == 255


def test_values_make_the_strokes_that_they_are_of_and_turned_ones_the_same_picture():
    job = painting()
    for windows in (False, True):
        again = strokes_of(values_of(job.strokes, windows=windows), windows=windows)
        difference = values_of(again, windows=True) - values_of(job.strokes, windows=True)
        assert difference[:, : None if windows else COUNT].abs().max() < 1e-4
    turned = orient_right(values_of(job.strokes, windows=False))
    assert (turned[:, Column.CHORD_X] >= 0).all()
    canvas = Canvas(job)
    drawn = canvas.draw(strokes_of(turned, windows=False).map(lambda value: value.float()))
    assert mean_square(drawn - canvas.draw(job.strokes)) < 1e-10


def test_only_strokes_that_do_not_overlap_are_exchanged_and_the_picture_keeps_its_bits():
    strokes, renderer = with_shapes(random_strokes(60, CANVAS)), Analytic()
    order = neighbouring_order(strokes, CANVAS, renderer)
    assert sorted(order.tolist()) == list(range(60))
    assert order.tolist() != list(range(60))
    y, x = torch.meshgrid(torch.arange(CANVAS[0]) + 0.5, torch.arange(CANVAS[1]) + 0.5, indexing="ij")
    alpha, _ = renderer(strokes).sample(torch.arange(60)[None], torch.stack([x, y], -1).reshape(1, -1, 2))
    paints = (alpha[0] > 0).float()
    overlap = (paints @ paints.T) > 0
    place = np.argsort(order)
    for low in range(60):
        for high in range(low + 1, 60):
            assert not overlap[low, high] or place[low] < place[high]
    canvas = Canvas(job_of(strokes, CANVAS))
    assert torch.equal(canvas.draw(strokes), canvas.draw(strokes[torch.from_numpy(order)]))
    middles = values_of(strokes, windows=False)[:, Column.MIDDLE_X : Column.MIDDLE_Y + 1].numpy()
    jumps = [np.linalg.norm(np.diff(middles[rows], axis=0), axis=1).mean() for rows in (order, np.arange(60))]
    assert jumps[0] < 0.7 * jumps[1]


@pytest.mark.parametrize("count", [0, 1, 150])
def test_a_decoded_painting_is_as_near_as_was_asked_and_has_all_its_strokes(count, tmp_path):
    job = painting(count)
    (path,) = Bits(fidelity=40, steps=12).write(job, tmp_path)
    saved = load_catalogue(path)
    assert (len(saved.strokes), saved.size) == (count, CANVAS)
    again = export_job(saved)
    assert picture_psnr(again.picture(), job.picture()) > 39.5


def test_descent_while_rounding_saves_bits_and_a_finer_file_takes_more():
    job = painting(150)
    quick, slow, fine = (
        len(code(job, allowed=allowed, steps=steps).data) for allowed, steps in ((1e-4, 0), (1e-4, 48), (1e-5, 48))
    )
    assert slow < 0.95 * quick
    assert fine > 1.1 * slow


@pytest.mark.parametrize("name", ["analytic", "textured", "marks", "neural", "inverse_vgg"])
def test_a_file_has_whatever_its_renderer_draws(name, tmp_path):
    renderer = build_named("renderer", name, {}).eval()
    strokes = random_strokes(5, CANVAS)
    strokes = replace(renderer.convert(strokes), brush=torch.tensor([7, 3, 9, 1, 12]))
    job = job_of(strokes, CANVAS, renderer=renderer, depth=torch.tensor([2, 0, 4, 3, 1]))
    job = changed(job, renderer=name)
    (path,) = Bits(fidelity=40, steps=0).write(job, tmp_path)
    saved = load_catalogue(path)
    decoded = replace(job, saved=replace(job.saved, strokes=saved.strokes, depth=saved.depth))
    assert picture_psnr(decoded.picture(), job.picture()) > 39
    assert saved.renderer == name


def test_strokes_at_the_ends_of_their_ranges_are_coded(tmp_path):
    ends = {
        name: torch.stack([torch.full(field.shape(1)[1:], bound) for bound in (field.low, field.high)])
        for name, field in FIELDS.items()
    }
    job = job_of(Strokes.join(Strokes(**ends), random_strokes(3, CANVAS)), CANVAS)
    (path,) = Bits(steps=2).write(job, tmp_path)
    assert len(load_catalogue(path).strokes) == 5


def test_alpha_settings_and_ground_come_back(tmp_path):
    alpha = torch.arange(12, dtype=torch.uint8).reshape(3, 4)
    config = "renderer:\n  _target_: renderer/analytic\n  soft: 1.25\n  taper: 0.5\nimage: a.png\n"
    job = painting(4, alpha=alpha, config=config, seed=2**63, background=torch.tensor([0.1, 0.5, 1.0]))
    (path,) = Bits(steps=0).write(job, tmp_path)
    saved = load_catalogue(path)
    assert torch.equal(saved.alpha, alpha)
    assert saved.seed == 2**63
    assert "soft: 1.25" in saved.config
    assert "image" not in saved.config, "settings that do not affect the picture are omitted"
    assert torch.allclose(saved.background, job.saved.background, atol=1e-5)


def test_every_flipped_byte_and_every_cut_is_told(tmp_path):
    (path,) = Bits(steps=0).write(painting(5), tmp_path)
    whole = path.read_bytes()
    for at in range(len(whole)):
        path.write_bytes(whole[:at] + bytes([whole[at] ^ 1 << at % 8]) + whole[at + 1 :])
        assert str(path) in refusal(load_catalogue, path)
        path.write_bytes(whole[:at])
        refusal(load_catalogue, path)


def test_a_file_of_the_future_and_other_files_are_refused(tmp_path):
    path = tmp_path / "a.bits"
    path.write_bytes(HEAD.pack(MAGIC, VERSION + 1, 0) + bytes(40))
    refuses(f"a.bits: has format_version {VERSION + 1}, and this brushexp reads {VERSION}", load_catalogue, path)
    path.write_bytes(b"something else that is long enough")
    refuses("not a file of coded strokes; give a strokes.bits", load_catalogue, path)
    refuses("there is no file", load_catalogue, tmp_path / "none.bits")


@given(st.binary(max_size=120), st.integers(0, 2**32 - 1))
@settings(max_examples=60, deadline=None)
def test_made_up_bytes_with_a_right_checksum_are_refused_or_read(noise, mask):
    body = SIZES.pack(3, 4, 5, mask, 0, 0, 0, 0, 0) + noise
    data = HEAD.pack(MAGIC, VERSION, zlib.crc32(body)) + body
    with pytest.raises(Exception):  # noqa: B017, PT011  (`load_catalogue` makes a UserError of any)
        read_bits(data).check()


def test_the_metric_has_the_psnr_of_the_file_that_it_counts():
    job = painting(60)
    image = torch.from_numpy(job.picture()).permute(2, 0, 1) / 255
    target = (image + 0.03 * torch.randn(image.shape, generator=torch.Generator().manual_seed(0))).clamp(0, 1)
    target = (target * 255).round() / 255
    before = psnr_of(mean_square(image - target))
    few, many = BitsPerPixel(loss=0.5, steps=12), BitsPerPixel(loss=0.05, steps=12)
    sizes = [metric(Comparison(image, target, None, job.strokes, job)) for metric in (few, many)]
    assert sizes[0] < sizes[1]
    for metric in (few, many):
        assert before - metric.loss - 0.03 < metric.remarks["psnr_decoded"] < before + 0.3
    assert BitsPerPixel(steps=0)(Comparison(image, image, None, job.strokes, job)) > sizes[1]
