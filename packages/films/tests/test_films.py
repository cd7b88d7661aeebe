"""Test that strokes are carried from frame to frame without flicker, and that finished frames are never lost."""

import errno
import json
import logging
import math
import os
import signal
from contextlib import contextmanager
from dataclasses import replace
from fractions import Fraction
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from brushexp_films import task
from brushexp_films.carrying import Carrier, Cel, Reel, find_strokes, shares_within
from brushexp_films.changes import Flicker
from brushexp_films.sound import add_sound
from brushexp_losses.direction import Direction
from films import as_tensor, decoded, encoded, scene
from painters import take
from program import ended
from refusals import refuses

from brushexp.cli.program import expand_arguments
from brushexp.compositing.layers import SOFT_EDGE
from brushexp.config.check import check
from brushexp.config.compose import compose_config
from brushexp.painting.canvas_memory import find_reaching
from brushexp.painting.components import standard_components
from brushexp.painting.stroke_optimizer import StrokeOptimizer
from brushexp.pictures.decode import read_picture
from brushexp.pictures.region import Region
from brushexp.plugins.init.grid import Grid
from brushexp.plugins.loss.mse import MeanSquaredError
from brushexp.plugins.loss.perceptual import Perceptual
from brushexp.registry import build_named
from brushexp.strokes.catalogue import FIELDS, Catalogue, check_strokes
from brushexp.strokes.storage import load_catalogue
from brushexp.system.files import TEMPORARY
from brushexp.tasks import export

av = pytest.importorskip("av")


def reel_of(renderer: str, n: int = 100, steps: int = 0) -> Reel:
    parts = standard_components(build_named("renderer", renderer, {}), steps=steps)
    carrier = Carrier(parts, parts.stages[-1].renderer.requires_grad_(False), 4)

    def begin(picture):
        strokes = build_named("init", "slic", {})(picture, n, torch.Generator().manual_seed(0), None)
        painter = StrokeOptimizer(Catalogue(strokes, parts.optimizer.units), parts, picture, torch.ones(3), seed=0)
        take(painter, steps)
        return Cel(painter.strokes(), painter.depth.front_to_back, torch.ones(3))

    return Reel(begin, carrier, 0.04)


@pytest.mark.parametrize("renderer", ["analytic", "textured"])
def test_strokes_move_where_the_film_changes_and_all_others_stay_bit_for_bit(renderer):
    reel = reel_of(renderer)
    pictures = [as_tensor(picture) for picture in scene(4)]
    reel.paint(pictures[0])
    for picture in pictures[1:]:
        before, image = reel.cel, reel.image
        reel.paint(picture)
        after = reel.cel
        check_strokes(after.strokes)
        moved = torch.stack(
            [(getattr(after.strokes, name) != getattr(before.strokes, name)).reshape(100, -1).any(1) for name in FIELDS]
        ).any(0)
        assert 0 < int(moved.sum()) < 60
        assert torch.equal(after.front_to_back.sort().values, torch.arange(100))
        stay = [n for n in after.front_to_back.tolist() if not moved[n]]
        assert stay == [n for n in before.front_to_back.tolist() if not moved[n]], "the other strokes keep their depth"
        whole = Region.whole(picture)
        was_there = find_reaching(before.strokes[moved], whole, SOFT_EDGE)
        away = ~(was_there | find_reaching(after.strokes[moved], whole, SOFT_EDGE))
        assert away.sum() > 500
        assert torch.equal(reel.image[:, away], image[:, away])
        error = [(painting - picture).square().mean() for painting in (reel.image, image)]
        assert error[0] < error[1]


def test_strokes_depend_on_those_of_the_picture_before_alone_whatever_losses_remember():
    def carrier():
        losses = {"perceptual": Perceptual(), "direction": Direction()}
        parts = standard_components(build_named("renderer", "analytic", {}), steps=0, losses=losses)
        return Carrier(parts, parts.stages[-1].renderer.requires_grad_(False), 3)

    reel, used = reel_of("analytic"), carrier()
    first, second = (as_tensor(picture) for picture in scene(2))
    reel.paint(first)
    still, all_of_it = torch.zeros(2, *first.shape[1:]), torch.ones(first.shape[1:], dtype=torch.bool)
    for _ in range(2):
        carried = used(reel.cel, reel.image, second, all_of_it, still)
    fresh = carrier()(reel.cel, reel.image, second, all_of_it, still)
    assert all(torch.equal(value, getattr(fresh.strokes, name)) for name, value in carried.strokes.items())


def test_a_film_that_stands_still_is_one_painting_a_cut_begins_another_and_both_flicker_little():
    reel, still = reel_of("analytic"), as_tensor(scene(1)[0])
    reel.paint(still)
    cel = reel.cel
    reel.paint((still + 0.01).clamp(0, 1))
    assert reel.cel is cel
    reel.paint(1 - still)
    assert (reel.cel is cel, reel.scenes) == (False, 2)
    carried, anew, reel = Flicker(), Flicker(), reel_of("analytic", 900, 40)
    for k, picture in enumerate(scene(4, side=96)):
        noisy = as_tensor(picture) + 0.004 * torch.randn(3, 96, 96, generator=torch.Generator().manual_seed(k))
        reel.paint(noisy)
        carried.add(reel.image, noisy)
        alone = reel_of("analytic", 900, 40)
        alone.paint(noisy)
        anew.add(alone.image, noisy)
    assert carried.value < 0.2 * anew.value


def test_shares_of_strokes_within_a_mask_and_strokes_that_meet_a_region_agree_with_their_pictures():
    picture = as_tensor(scene(1)[0])
    strokes = Grid()(picture, 60, torch.Generator(), None)
    renderer, blend = build_named("renderer", "analytic", {}), build_named("blend", "dense", {})
    half = torch.zeros(64, 64, dtype=torch.bool)
    half[:, :32] = True
    region = Region(8, 8, 20, 20)
    near = find_strokes(strokes, region, SOFT_EDGE)
    for n, share in enumerate(shares_within(strokes, half).tolist()):
        one = strokes[n : n + 1]
        black = replace(one, color=torch.ones(1, 3), opacity=torch.ones(1))
        cover = blend(renderer(black), torch.tensor([0]), (64, 64), torch.zeros(3)).image[0]
        assert share == pytest.approx(float(cover[:, :32].sum() / cover.sum()), abs=0.25)
        if region.of(cover).any():
            assert n in near


@pytest.mark.parametrize("look", ["look=oil", "look=ink"])
def test_a_painted_film_has_its_pictures_their_strokes_and_its_numbers(run_task, tmp_path, look):
    clip = encoded(tmp_path / "clip.mp4", scene(7), rate=10)
    words = (f"image={clip}", look, "resolution=47", "steps=3", "film.every=2", "film.start=0.1", "film.steps=2")
    metrics = run_task(task, *words)
    frames, rate = decoded(tmp_path / "film.mp4")
    assert (len(frames), rate, frames[0].shape) == (3, Fraction(5), (48, 48, 3))
    assert (metrics["n_frames"], metrics["n_scenes"], metrics["status"]) == (3, 1, "completed")
    assert metrics == json.loads((tmp_path / "metrics.json").read_text())
    saved = [load_catalogue(tmp_path / "frames" / f"00000{k}.h5") for k in range(3)]
    assert {len(one.strokes) for one in saved} == {metrics["n_strokes"]}
    assert {one.size for one in saved} == {(47, 47)}
    preview = read_picture(tmp_path / "preview.png")
    assert preview.shape == (47, 3 * 47, 3)
    last = preview[:, 2 * 47 :].astype(float)
    run_task(export, "task=export", f"catalogue={tmp_path / 'frames' / '000002.h5'}", "overwrite=true")
    same = np.abs(read_picture(tmp_path / "painting.png") - last).max() <= 1
    assert same, "exporters get the same picture with light"
    assert np.abs(frames[2][:47, :47] - last).mean() < 8
    assert not (tmp_path / "checkpoint.ckpt").exists()


@pytest.mark.parametrize(("words", "message"), [
    (["wet=0.5"], "wet=0.5 is for single pictures"),
    (["style=coffee"], "style.image=coffee is for single pictures"),
    (["film.start=2", "film.stop=1"], "film.stop=1 is not after"),
    (["film.start=9", "steps=0"], "film.start=9 is after the end"),
])  # fmt: skip
def test_what_a_film_cannot_have_is_refused_in_one_line(run_task, tmp_path, words, message):
    clip = encoded(tmp_path / "clip.mp4", scene(2))
    refuses(message, run_task, task, f"image={clip}", "resolution=32", *words)
    assert not (tmp_path / "checkpoint.ckpt").exists(), "there is no painting to continue"


def test_a_film_can_be_stopped_before_it_says_how_long_it_is_and_a_picture_without_error_hides_no_other(
    run_task, tmp_path, monkeypatch
):
    @contextmanager
    def at_once(stop, message):
        stop()
        yield

    monkeypatch.setattr(task.PaintedFilm, "planned", 1)
    monkeypatch.setattr("brushexp_films.task.interruptible", at_once)
    with pytest.raises(KeyboardInterrupt):
        run_task(task, f"image={encoded(tmp_path / 'clip.mp4', scene(3))}", "resolution=32", "steps=1", "film.steps=1")
    metrics = json.loads((tmp_path / "metrics.json").read_text())
    assert (metrics["n_frames"], metrics["status"]) == (1, "interrupted")
    others = {"flicker": SimpleNamespace(value=0), "cfg": SimpleNamespace(loss=["mse"])}
    others |= {"reel": SimpleNamespace(scenes=1, cel=SimpleNamespace(strokes=()))}
    for psnr, expected in (([math.inf, 20.0, 30.0], 25.0), ([math.inf], math.inf)):
        film = SimpleNamespace(psnr=psnr, seconds=[], device="cpu", **others)
        assert task.PaintedFilm.metrics(film, None, "completed")["psnr"] == expected


def test_a_film_that_is_stopped_in_its_first_picture_says_how_to_begin_anew(tmp_path):
    encoded(tmp_path / "clip.mp4", scene(2))
    words = ["image=clip.mp4", "resolution=32", "steps=1", "threads=1", "output=x"]
    code, output = ended(tmp_path, *words, kill=("checkpoint.ckpt", 1, True), sent=signal.SIGINT)
    assert (code, output) == (130, "note: interrupted; continue with: brushexp task=film resume=x\n")
    assert ended(tmp_path, "task=film", "resume=x")[0] == 0
    assert len(decoded(tmp_path / "x" / "film.mp4")[0]) == 2


def test_a_film_that_was_killed_goes_on_to_the_same_strokes_although_one_picture_is_damaged(tmp_path):
    clip = encoded(tmp_path / "clip.mp4", scene(4))
    words = (f"image={clip}", "resolution=32", "steps=3", "film.steps=2", "threads=1")
    assert ended(tmp_path, *words, "output=whole")[0] == 0
    code, output = ended(tmp_path, *words, "output=killed", kill=("000001.h5", 1, True))
    assert code == -signal.SIGKILL, output
    os.truncate(tmp_path / "killed" / "frames" / "000001.h5", 999)
    code, output = ended(tmp_path, "resume=killed")
    assert code == 0, output
    assert "000001.h5 is damaged" in output
    assert "killed/film.mp4  4 pictures\n" in output
    assert " s per picture" not in output
    assert " s per picture" in (tmp_path / "killed" / "run.log").read_text()
    assert len(decoded(tmp_path / "killed" / "film.mp4")[0]) == 4
    for k in range(4):
        one, other = (load_catalogue(tmp_path / run / "frames" / f"00000{k}.h5") for run in ("whole", "killed"))
        assert torch.equal(one.depth, other.depth)
        for name in FIELDS:
            assert torch.equal(getattr(one.strokes, name), getattr(other.strokes, name)), (k, name)


@pytest.mark.parametrize("what", ["disk", "nan"])
def test_what_ends_a_film_leaves_the_pictures_before_it(run_task, tmp_path, monkeypatch, caplog, what):
    pictures = scene(2)
    clip = encoded(tmp_path / "clip.mp4", [*pictures, *(255 - picture for picture in pictures)])
    words = (f"image={clip}", "resolution=32", "steps=3", "film.steps=2", "threads=1")
    fsync, forward, frames = os.fsync, MeanSquaredError.forward, tmp_path / "frames"

    def full(descriptor):
        if os.readlink(f"/proc/self/fd/{descriptor}").endswith(".h5") and (frames / "000001.h5").exists():
            raise OSError(errno.ENOSPC, "No space left on device")
        fsync(descriptor)

    with monkeypatch.context() as patched:
        if what == "disk":
            patched.setattr("brushexp.system.files.os.fsync", full)
        else:
            wrong = lambda *args: forward(*args) * (torch.nan if (frames / "000000.h5").exists() else 1)  # noqa: E731
            patched.setattr(MeanSquaredError, "forward", wrong)
        message = r"000002.h5: No space left" if what == "disk" else "step 1: loss=mse is nan; lower the rate"
        refuses(message, run_task, task, *words)
    assert (what == "nan") == ("the strokes stay as they were" in caplog.text)  # the carrier's warning
    metrics = json.loads((tmp_path / "metrics.json").read_text())
    assert (metrics["n_frames"], metrics["status"]) == (2, "failed")
    assert len(decoded(tmp_path / "film.mp4")[0]) == 2
    assert (tmp_path / "checkpoint.ckpt").exists()
    assert not list(tmp_path.rglob(TEMPORARY))


@pytest.mark.parametrize("codec", ["aac", "pcm_s16le"])
def test_sound_is_copied_from_its_second_on_or_told_and_left_out(tmp_path, caplog, codec):
    with av.open(str(tmp_path / "heard.mkv"), "w") as container:
        stream = container.add_stream(codec, rate=48_000)
        silence = np.zeros((1, 4 * 48_000), np.float32)
        silence[:, 96_000:] = np.sin(np.arange(96_000) / 20)  # a tone that begins in the second second
        whole = av.AudioFrame.from_ndarray(silence, format="fltp", layout="mono")
        whole.sample_rate = 48_000
        fitting = av.AudioResampler(
            stream.format.name, stream.layout.name, 48_000, stream.codec_context.frame_size or 1024
        )
        for frame in [*fitting.resample(whole), *fitting.resample(None), None]:
            container.mux(stream.encode(frame))
    film = encoded(tmp_path / "film.mp4", scene(8), rate=4)
    before = film.read_bytes()
    add_sound(film, tmp_path / "heard.mkv", start=1.0)
    assert len(decoded(film)[0]) == 8
    if codec != "aac":
        assert film.read_bytes() == before
        assert "an MP4 cannot hold it" in caplog.text
        return
    with av.open(str(film)) as container:
        loud = np.concatenate([frame.to_ndarray()[0] for frame in container.decode(audio=0)])
    assert len(loud) == pytest.approx(2 * 48_000, abs=2100)
    assert np.abs(loud[:44_000]).max() < 0.1 < np.abs(loud[52_000:90_000]).max()


def test_the_words_for_a_picture_paint_a_film_too_and_keys_for_which_it_has_no_use_are_told(config, tmp_path, caplog):
    for words in (["clip.mp4"], ["task=paint", "image=clip.mp4"], ["-m", "image=a.mp4,b.mp4", "seed=0,1"]):
        assert "task=film" in expand_arguments(words)
        assert "task=paint" not in expand_arguments(words)
    assert "task=film" not in expand_arguments(["-m", "image=a.mp4,photo.jpg"])
    refuses("task=film handles this, not task=paint", check, compose_config(["image=clip.mp4"]))
    words = [f"image={encoded(tmp_path / 'clip.mp4', scene(2))}", "task=film", "frames=3", "report=false"]
    with caplog.at_level(logging.WARNING):
        check(config(*words), words)
    assert "films ignore frames, report: film.mp4 has" in caplog.text
