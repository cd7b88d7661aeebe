"""Tests of the Python API: it matches the command line's tasks and messages, and writes no files unless asked."""

import io
import json
import pickle
import subprocess
import sys
from importlib.metadata import entry_points

import numpy as np
import pytest
import torch
from films import pixels_of
from hydra import compose, initialize
from hydra.core.global_hydra import GlobalHydra
from PIL import Image
from refusals import refuses
from scenes import random_strokes
from torch.testing import assert_close

import brushexp
from brushexp.painting.reopen import export_job
from brushexp.pictures.held import hold
from brushexp.pictures.load import load_picture, samples
from brushexp.plugins.blend.tiled import log_slow_kernel
from brushexp.results.runs import command_of
from brushexp.runs import run_folder
from brushexp.runs.run_folder import lock
from brushexp.strokes.storage import load_catalogue
from brushexp.system.files import to_bytes
from brushexp.tasks import paint as task

resvg = pytest.importorskip("resvg_py", reason="pip install resvg-py: it draws our SVG independently")
SMALL = {"look": "plain", "resolution": 32, "strokes": 20, "steps": 4}
SAME = ("psnr", "ssim", "l1", "perceptual", "n_strokes", "steps", "status")  # metrics that are equal for equal runs


def small_cat() -> torch.Tensor:
    return (255 * load_picture("chelsea", 32)).round().byte()


def test_importing_the_package_loads_nothing_slow_and_hydra_of_another_program_stays_as_it_is():
    code = "import sys, brushexp; dir(brushexp); assert not {'torch', 'hydra', 'numpy'} & {*sys.modules}"
    subprocess.run([sys.executable, "-c", code], check=True)
    others = {point.name for point in entry_points(group=brushexp.FUNCTIONS)}
    assert {"analyse", "simulate", "train_renderer"} <= others
    assert {name for name in dir(brushexp) if getattr(brushexp, name)} == {*brushexp.__all__, *others}
    with pytest.raises(AttributeError, match="no attribute 'pain'"):
        brushexp.pain  # noqa: B018
    with initialize(config_path=None, version_base="1.2"):
        mine = GlobalHydra.instance().hydra
        assert brushexp.paint("chelsea", **SMALL).metrics["steps"] == 4
        refuses("nonsense is not a key", brushexp.paint, "chelsea", nonsense=1)
        assert GlobalHydra.instance().hydra is mine
        assert compose(overrides=["+a=1"]) == {"a": 1}


def test_a_painting_is_that_of_the_command_line_and_nothing_is_written(run_task, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    before = torch.get_rng_state()
    painting = brushexp.paint("chelsea", **SMALL, loss=["mse", "kl"], optimizer={"units": {"color": 0.5}})
    assert_close(torch.get_rng_state(), before, rtol=0, atol=0)
    assert not [*tmp_path.iterdir()]
    words = ["image=chelsea", "resolution=32", "strokes=20", "steps=4", "loss=[mse,kl]", "optimizer.units.color=0.5"]
    metrics = run_task(task, *words, "frames=0")
    assert {key: painting.metrics[key] for key in SAME} == {key: metrics[key] for key in SAME}
    assert np.array_equal(painting.image, pixels_of(tmp_path / "painting.png"))


def test_a_painting_on_a_transparent_canvas_has_the_alpha_of_its_picture(run_task, tmp_path):
    alpha = np.zeros((24, 32), np.uint8)
    alpha[4:20, 6:20], alpha[4:20, 20:26] = 255, 128
    sprite = np.dstack([np.full((24, 32, 3), (200, 40, 30), np.uint8), alpha])
    Image.fromarray(sprite).save(tmp_path / "sprite.png")
    run_task(task, f"image={tmp_path}/sprite.png", "look=plain", "strokes=20", "steps=4", "frames=0",
             "background=transparent")  # fmt: skip
    painting = brushexp.paint(sprite, look="plain", strokes=20, steps=4, background="transparent")
    (png,) = painting.export("png", tmp_path / "again")
    for path in (tmp_path / "painting.png", png):
        with Image.open(path) as image:
            assert image.mode == "RGBA"
            painted = np.asarray(image)
        assert np.abs(painted[..., 3].astype(int) - alpha).max() <= 1
        assert np.abs(painted[alpha > 0][:, :3] - np.array([200, 40, 30.0])).max() <= 8, "no fringe of white"
    saved = load_catalogue(tmp_path / "catalogue.h5")
    (text,) = painting.export("json", tmp_path / "text")
    assert torch.equal(load_catalogue(text).alpha, saved.alpha)
    assert np.abs(export_job(saved, resolution=64).alpha()[::2, ::2, 0].astype(int) - alpha).max() <= 128
    svg = bytes(resvg.svg_to_bytes(svg_string=(tmp_path / "strokes.svg").read_text(), skip_system_fonts=True))
    shown = np.asarray(Image.open(io.BytesIO(svg)))
    assert np.abs(shown[..., 3].astype(int) - alpha).max() <= 1
    with Image.open(painting.export("jpg", tmp_path, quality=100)[0]) as image:
        over = np.asarray(image)
    assert (over[0, 0] >= 250).all()
    assert np.abs(over[12, 12] - np.array([200.0, 40, 30])).max() <= 12
    opaque = brushexp.paint(sprite[..., :3], look="plain", strokes=9, steps=1, background="transparent")
    assert opaque.finished.job.alpha() is None


def test_a_painting_and_a_state_come_back_from_another_process(tmp_path):
    picture = np.random.default_rng(0).random((20, 32, 3))
    *_, state = brushexp.iterate(picture, **SMALL | {"look": "oil"}, frames=2)
    again = pickle.loads(pickle.dumps(state)).painting
    assert np.array_equal(again.image, state.image)
    assert np.array_equal(again.render(64), state.painting.render(64))
    assert again.metrics == state.painting.metrics
    assert again.save(tmp_path).is_file()
    code = "import pickle, sys; painting = pickle.load(sys.stdin.buffer); print(painting.metrics['psnr'])"
    there = subprocess.run(
        [sys.executable, "-c", code], input=pickle.dumps(again), capture_output=True, check=True, cwd=tmp_path
    )
    assert float(there.stdout) == again.metrics["psnr"]


@pytest.mark.parametrize(("name", "options", "words"), [
    ("recover", {"copies": 0}, "copies=0 is not 1 to 8; try copies=1"),  # used to skip all pixels and overrun memory
    ("recover", {"scale": float("nan")}, "scale=nan is not 0.05 to 8"),
    ("recover", {"weights": "x"}, r"^weights=x is not a shipped checkpoint \(.*\); give the path of a .\w+ file$"),
    ("sample_brushwork", {"samples": 1}, "samples=1 is not 2 to 10000"),
    ("sample_brushwork", {"checkpoint": "x"}, "^checkpoint=x is not a shipped checkpoint"),
    ("analyse", {"radius": -1}, "radius=-1 is not at least 0"),
])  # fmt: skip
def test_functions_take_what_the_command_line_takes(name, options, words):
    refuses(words, getattr(brushexp, name), "chelsea", **options)


def test_a_run_with_a_folder_leaves_all_and_can_be_repeated(tmp_path):
    picture = small_cat().permute(1, 2, 0).numpy() / 255
    run = tmp_path / "a run"
    painting = brushexp.paint(picture, **SMALL | {"resolution": None}, output=run)
    files = {path.name for path in run.iterdir()}
    assert {"painting.png", "catalogue.h5", "report.html", "timelapse.mp4", "curves"} <= files
    assert json.loads((run / "metrics.json").read_text())["psnr"] == painting.metrics["psnr"]
    assert f"'image={run}/.hydra/image.tif'" in command_of(run)
    again = load_picture(str(run / ".hydra" / "image.tif"), None)
    assert_close(again, torch.from_numpy(picture).permute(2, 0, 1).float())
    refuses("already holds a run", brushexp.paint, picture, **SMALL, output=run)
    painting.save(tmp_path / "b")
    assert f" image={tmp_path}/b/.hydra/image.tif " in command_of(tmp_path / "b")
    assert not [held for held in run_folder._locks if str(run) in held.lock_file], "a refusal keeps nobody out"
    brushexp.paint(picture, **SMALL, output=run, overwrite=True)
    lock(run)  # it is unlocked


def test_a_painting_is_drawn_exported_and_saved_later(tmp_path):
    painting = brushexp.paint(small_cat(), **SMALL, light={"depth": 1})
    assert np.array_equal(painting.render(), painting.image)
    assert not np.array_equal(painting.render(light=False), painting.image)
    assert painting.render(100).shape == (round(100 * 21 / 32), 100, 3)
    assert [path.name for path in painting.export("svg", tmp_path / "new", digits=1)] == ["strokes.svg"]
    refuses("to=sgv is not among the plugins here", painting.export, "sgv", tmp_path)
    for size in (0, float("nan"), 10**9, (64, 32), "64"):
        refuses(r"size=.* is not 1 to 65536; try size=32", painting.render, size)
    same = {"depth": painting.depth, "background": painting.background, "soft": 1.5}  # as in look=plain
    drawn = brushexp.render(painting.strokes, (21, 32), **same)
    assert np.abs(to_bytes(drawn).astype(int) - painting.render(light=False)).max() <= 1
    assert brushexp.render(painting.strokes, 9).shape == brushexp.render(painting.strokes, np.array([9, 9])).shape
    wrong_sizes = ({"size": size} for size in ((0, 9), (9,), (9.5, 9), "9", 0, 9.0))
    for wrong in (*wrong_sizes, {"depth": torch.arange(99)}, {"background": torch.zeros(4)}):
        with pytest.raises(brushexp.UserError, match=r"is not a canvas size; give height and width|has shape"):
            brushexp.render(**{"strokes": painting.strokes, "size": (9, 9)} | wrong)
    with pytest.raises(brushexp.UserError, match="soft: this renderer is built already"):
        brushexp.render(painting.strokes, (9, 9), renderer=brushexp.create("renderer", "analytic"), soft=2.0)
    page = painting.save(tmp_path / "kept")
    files = {path.name for path in page.parent.iterdir()}
    assert files >= {"painting.png", "flat.png", "target.png", "catalogue.h5", "report.html"}
    assert "timelapse.mp4" not in files
    assert painting._repr_html_().startswith("<iframe")
    assert "20 strokes on 32 x 21 pixels" in repr(painting)


def test_paint_that_is_to_be_trained_is_asked_for_and_the_slow_way_is_told_once(caplog):
    strokes = random_strokes(5, (20, 30))
    log_slow_kernel.cache_clear()
    frozen = brushexp.create("renderer", "textured")
    assert not any(value.requires_grad for value in frozen.parameters())
    assert_close(
        brushexp.render(strokes, (20, 30), renderer="textured"), brushexp.render(strokes, (20, 30), renderer=frozen)
    )
    assert not caplog.messages
    picture = brushexp.render(strokes, (20, 30), renderer=frozen.requires_grad_())
    picture.mean().backward()
    assert frozen.textures.grad.abs().sum() > 0
    brushexp.render(strokes, (20, 30), renderer=frozen)
    brushexp.render(strokes.map(torch.Tensor.double), (20, 30))
    slow = "PyTorch draws the strokes, many times slower than compiled kernels: "
    reasons = ["renderer.requires_grad_(False) freezes", "they are torch.float64, but kernels need float32"]
    assert len(caplog.messages) == 2
    for message, reason in zip(caplog.messages, reasons, strict=True):
        assert message.startswith(slow)
        assert reason in message


def test_a_painting_is_saved_beside_what_is_the_users_in_place_of_another_and_ends_its_film(tmp_path):
    lit, unlit = (brushexp.paint("chelsea", **SMALL, light={"depth": depth}, frames=2 * depth) for depth in (1, 0))
    for name in ("table.csv", "image.png"):
        (tmp_path / name).write_text("mine")
    lit.save(tmp_path)
    assert (tmp_path / "timelapse.mp4").is_file()
    unlit.save(tmp_path)
    assert not {"flat.png", "timelapse.mp4"} & {path.name for path in tmp_path.iterdir()}
    brushexp.paint(small_cat(), **SMALL, output=tmp_path, overwrite=True)
    assert {(tmp_path / name).read_text() for name in ("table.csv", "image.png")} == {"mine"}
    painting = brushexp.paint("chelsea", **SMALL | {"steps": 90, "psnr": 5}, frames=3, wet=1)
    frames = painting.finished.timelapse.frames
    assert 0 < painting.metrics["steps"] == max(frames) < 90
    with Image.open(io.BytesIO(frames[max(frames)])) as last:
        assert np.abs(np.asarray(last, float) - painting.image).mean() < 3


@pytest.fixture
def quickly_measured(monkeypatch):
    """Make the evaluation of trained renderers fast by using few strokes."""
    monkeypatch.setattr("brushexp_training.evaluation.benchmark.ACROSS", 2)
    monkeypatch.setattr("brushexp_training.evaluation.benchmark.REPETITIONS", 1)
    monkeypatch.setattr("brushexp_training.stroke_sets.stroke_data.HELD_OUT", 128)


def test_a_renderer_or_a_preset_of_one_is_trained_and_paints(tmp_path, quickly_measured, monkeypatch):
    tiny = {"renderer.width": 4, "renderer.dense": 16, "renderer.code": 2}
    how = {"engine": "disc", "simulate": 100, "sets": str(tmp_path), "epochs": 1, "batch_size": 32, "fid": 0, **tiny}
    trained = brushexp.train_renderer(tmp_path / "run", minutes=None, device="cpu", **how)
    recipe = json.loads((tmp_path / "run" / "neural.json").read_text())
    assert trained.weights_hash == recipe["hash"]
    assert recipe["training"]["steps"] > 0
    weights = {"renderer.checkpoint": str(tmp_path / "run" / "neural.safetensors"), **tiny}
    painting = brushexp.paint("chelsea", **SMALL, renderer="neural", warm_up=None, **weights)
    assert painting.metrics["n_strokes"] == SMALL["strokes"]
    monkeypatch.chdir(tmp_path)
    how = {"engine": "disc", "simulate": None, "epochs": 0, "fid": 0, "minutes": None, "device": "cpu"}
    how |= {"renderer.width": 2, "renderer.widest": 2}
    trained = brushexp.train_renderer("preset", renderer="neural_thesis", **how)
    assert type(trained).__name__ == "InverseVGG"


class OfAnotherLibrary:
    """An array like those of JAX, h5py or xarray."""

    def __init__(self, array):
        self.array = array

    def __array__(self, dtype=None, copy=None):
        return self.array


def kinds_of_picture() -> dict[str, object]:
    pixels = load_picture("chelsea", 32)
    eight_bit = (pixels * 255).round().byte()
    array = eight_bit.permute(1, 2, 0).numpy()
    Image.fromarray(array).save(file := io.BytesIO(), "PNG")
    return {
        "tensor": eight_bit,
        "array": array,
        "with alpha": np.dstack([array, np.full_like(array[..., 0], 255)]),
        "blue first": array[..., ::-1].copy()[..., ::-1],
        "batch": eight_bit[None],
        "pillow": Image.fromarray(array),
        "bytes": file.getvalue(),
        "file": file,
        "of another library": OfAnotherLibrary(array),
        "floats": eight_bit.permute(1, 2, 0).numpy() / 255,
        "float tensor": (eight_bit / 255).requires_grad_(),
    }


def test_a_picture_may_be_of_any_kind():
    small = SMALL | {"resolution": None}
    first, *others = (brushexp.paint(picture, **small) for picture in kinds_of_picture().values())
    for other in others:
        assert np.array_equal(other.target, first.target)
        assert np.array_equal(other.image, first.image)
    ramp = np.linspace(0, 1, 70 * 64).reshape(70, 64)
    grey = brushexp.paint(ramp, **small, style=Image.fromarray(np.uint8(255 * ramp.T)))
    assert grey.image.shape == (70, 64, 3)
    assert "style_poly" in grey.metrics


def test_transparent_pixels_lie_over_white_and_count_nothing_in_a_mask_and_true_is_bright():
    color, alpha = np.full((4, 5, 3), 51, np.uint8), np.array([[0, 255, 255, 255, 102]] * 4, np.uint8)
    rgba = np.dstack([color, alpha])
    expected = {1.0: [255, 51, 51, 51, 173], 0.0: [0, 51, 51, 51, 20]}  # 0.4 * 51 plus 0.6 of the backdrop
    for backdrop, row in expected.items():
        for picture in (rgba, rgba / 255, torch.from_numpy(rgba).permute(2, 0, 1), Image.fromarray(rgba)):
            pixels = hold(picture).over[backdrop]
            assert_close(pixels[0, :, 0] * (1 if pixels.dtype == np.uint8 else 255), np.array(row), atol=1, rtol=0,
                         check_dtype=False)  # fmt: skip
    premultiplied = Image.merge("LA", [Image.fromarray(color[..., 0]), Image.fromarray(alpha)]).convert("La")
    np.testing.assert_allclose(hold(premultiplied).over[1.0][0, :, 0], expected[1.0], atol=1)
    assert np.array_equal(hold(alpha > 102).over[1.0][0, :, 2], [0, 255, 255, 255, 0])


def closed_picture() -> Image.Image:
    with Image.open(samples()["chelsea"]) as picture:
        return picture


@pytest.mark.parametrize(("picture", "options", "words"), [
    ("astronaut", {"stepz": 3}, "stepz is not a key of task=paint; did you mean steps"),
    ("astronaut", {"steps": "many"}, "steps=many is not a whole number; try steps=500"),
    ("astronaut", {"resume": "x"}, "resume=x does not work in Python"),
    ("astronaut", {"callbacks": ["timer"]}, "say where with output="),
    ("astronaut", {"logger": ["tensorboard"]}, "logger=tensorboard may write files; say where with output="),
    ("nowhere.png", {}, "image=nowhere.png is not there"),
    (np.zeros((4, 4, 2)), {}, r"image is an array of shape \(4, 4, 2\); give a path"),
    (np.full((4, 4), 7.0), {}, "image is an array of float64 from 7 to 7; give image / 255, floats from 0 to 1"),
    (np.full((4, 4), 999, np.uint16), {}, "image is an array of uint16 from 999 to 999; give image / 65535"),
    (np.eye(4, dtype=int), {}, r"image is an array of int64 from 0 to 1; give image.astype\(bool\), if it is a mask"),
    (np.eye(4) * 2 - 1, {}, r"float64 from -1 to 1; give \(image \+ 1\) / 2, if it goes from -1 to 1"),
    (np.full((4, 4), np.nan), {}, r"image is an array of float64 from nan to nan; give np.nan_to_num\(image\)"),
    (np.ma.masked_less(np.eye(4), 1), {}, "image is a masked array; fill the masked pixels"),
    (np.array([["a"]]), {}, "image is an array of <U1; give"),
    (np.matrix(np.full((4, 4), 7.0)), {}, "image is an array of float64 from 7 to 7; give"),
    (torch.rand(2, 5, 6), {}, "image is a tensor of shape"),
    (torch.rand(3, 4, 5).to_sparse(), {}, "image is a sparse"),
    (torch.rand(3, 4, 5, device="meta"), {}, "image is a sparse, .* or meta tensor"),
    (torch.zeros(3, 4, 5, dtype=torch.cfloat).conj(), {}, "image is a sparse, quantized, complex"),
    (Image.new("RGB", (0, 0)), {}, "image has no pixels; give"),
    (Image.fromarray(np.full((4, 4), np.nan, np.float32)), {}, "image has pixels that are NaN or infinite"),
    (torch.rand(5, 6, 3), {}, r"permute\(2, 0, 1\) puts the channels first"),
    (np.zeros((3, 4, 6)), {}, r"transpose\(1, 2, 0\) puts the channels last"),
    (b"no picture" * 1000, {}, "^image, 10000 bytes, is not a picture of a known format; .{1,60}$"),
    (Image.new("I", (4, 4), 200), {}, r"values up to 200, nearly black; give image.convert\('L'\)"),
    ([[0.5, 0.5], [0.5, 0.5]], {}, r"a list of 2; for an array of numbers, give np.array\(image\)"),
    (io.TextIOWrapper(io.BytesIO(b"\x89PNG")), {}, 'image is a file opened as text; open it with "rb"'),
    (io.StringIO("x"), {}, 'image is a file opened as text; open it with "rb"'),
    (["a.jpg", "b.jpg"], {}, "image takes one picture, and this is a list of 2; give one after the other"),
    ("astronaut", {"style": [np.zeros((4, 4))] * 2}, "style takes one picture, .* list of 2; give one of them"),
    ("astronaut", {"style": ["coffee", "rocket"]}, "only one value is allowed; try style.image=coffee"),
    (closed_picture(), {}, "image is closed or damaged; give"),
    ({}, {}, "image={} is empty; leave it out"),
    (
        "astronaut",
        {"focus": np.ones((3, 9))},
        "focus=.* pixels, the picture 32 x 32; give one with the same aspect ratio",
    ),
])  # fmt: skip
def test_a_mistake_is_a_message_of_one_line(picture, options, words):
    for call in (brushexp.paint, brushexp.iterate):  # immediately, not with the first state
        refuses(words, call, picture, **SMALL | options)
