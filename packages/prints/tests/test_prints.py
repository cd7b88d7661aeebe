"""Layers, strokes in space, relief and the film of the painting: their form, and that they show the painting."""

import json
import logging
import struct
from dataclasses import replace
from io import BytesIO
from itertools import pairwise
from xml.etree import ElementTree
from zipfile import ZIP_STORED, ZipFile

import numpy as np
import pytest
import torch
from brushexp_policies.topk import TopK
from brushexp_prints.process import Process, schedule, shrink_to_side, states
from brushexp_prints.relief import Relief
from brushexp_testing.families import some_strokes
from catalogues import changed
from catalogues import job_of as of_catalogue
from films import decoded, pixels_of, unrolled
from PIL import Image, ImageCms
from psd_tools import PSDImage
from psd_tools.constants import Resource
from refusals import refuses
from scenes import Windowed, random_strokes, with_shapes

from brushexp.compositing import bands as banding
from brushexp.plugins.blend.dense import Dense
from brushexp.plugins.blend.tiled import Tiled
from brushexp.plugins.export.base import ExportJob
from brushexp.plugins.export.job import export_job
from brushexp.registry import build_named
from brushexp.shading.light import Light, normals_of, shade_picture
from brushexp.strokes.bezier import curve_of, cut_short, drift_of, half_width_of, point_at
from brushexp.strokes.catalogue import Strokes
from brushexp.strokes.saved import Saved
from brushexp.system.files import to_bytes

SIZE = (24, 40)
N = 11


def job_of(**changes):
    strokes = some_strokes(N, SIZE)
    ground = torch.tensor([0.9, 0.8, 0.7])
    saved = Saved(strokes, torch.arange(N, dtype=torch.int32).flip(0), SIZE, ground, renderer="analytic")
    return replace(export_job(saved), **changes)


def layers_of(path):
    """The layers of a file, the lowest first, as names and pixels in [0, 1]."""
    with ZipFile(path) as archive:
        root = ElementTree.fromstring(archive.read("stack.xml"))
        layers = [*root.find("stack")][::-1]
        return root, [
            (one.get("name"), np.asarray(Image.open(BytesIO(archive.read(one.get("src")))), float) / 255)
            for one in layers
        ]


def shown(layers):
    below = np.zeros((*SIZE, 3))
    for _, pixels in layers:
        below = below + pixels[..., 3:] * (pixels[..., :3] - below)
    return 255 * below


CASES = {
    "plain": {},
    "light": {"light": Light(depth=1.0)},
    "pigments": {"space": build_named("color", "pigment", {})},
    "paper": {"paper": build_named("paper", "rough", {"tooth": 0.5, "grain": 200.0})},
}


@pytest.mark.parametrize("case", CASES)
def test_layers_show_the_painting_and_the_file_is_in_form(tmp_path, case):
    job = job_of(**CASES[case])
    (path,) = build_named("to", "ora", {"layers": 4, "dpi": 200.0}).write(job, tmp_path)
    with ZipFile(path) as archive:
        first = archive.infolist()[0]
        assert (first.filename, first.compress_type, first.header_offset) == ("mimetype", ZIP_STORED, 0)
        assert archive.read("mimetype") == b"image/openraster"
        merged, small = (
            np.asarray(Image.open(BytesIO(archive.read(name))))
            for name in ("mergedimage.png", "Thumbnails/thumbnail.png")
        )
    root, layers = layers_of(path)
    assert [root.get(key) for key in ("w", "h", "xres")] == ["40", "24", "200"]
    assert [name.split(",")[0] for name, _ in layers[:5]] == [
        "ground",
        "3 strokes",
        "3 strokes",
        "3 strokes",
        "2 strokes",
    ]
    assert [name for name, _ in layers[5:]] == ["light and paper"] * (case != "plain")
    assert np.array_equal(merged, job.picture())
    assert np.array_equal(small, merged)
    assert np.abs(shown(layers) - merged).max() <= 2.5


def test_a_layer_has_its_strokes_alone(tmp_path):
    job = job_of()
    (path,) = build_named("to", "ora", {"layers": N}).write(job, tmp_path)
    _, layers = layers_of(path)
    number = job.bottom_up[-1:]
    alone = replace(job.saved, strokes=job.strokes[number], depth=job.saved.depth[number])
    over = replace(job, saved=replace(alone, background=torch.zeros(3))).picture()
    _, pixels = layers[-1]
    assert np.abs(255 * pixels[..., 3:] * pixels[..., :3] - over).max() < 1.5
    assert (pixels[..., 3] == 0).any()


def test_a_transparent_painting_stays_so_and_one_without_strokes_is_its_ground(tmp_path):
    alpha = torch.zeros(SIZE, dtype=torch.uint8)
    alpha[:, 20:] = 255
    job = job_of()
    (path,) = build_named("to", "ora", {}).write(replace(job, saved=replace(job.saved, alpha=alpha)), tmp_path)
    _, layers = layers_of(path)
    assert all((pixels[:, :19, 3] == 0).all() for _, pixels in layers)
    assert np.abs(shown(layers) - job.picture())[:, 21:].max() <= 2.5
    bare = replace(job.saved, strokes=job.strokes[:0], depth=job.saved.depth[:0])
    (path,) = build_named("to", "ora", {}).write(replace(job, saved=bare), tmp_path)
    _, layers = layers_of(path)
    assert [name for name, _ in layers] == ["ground"]
    assert layers[0][1][0, 0].tolist() == pytest.approx([0.9, 0.8, 0.7, 1], abs=0.003)


def written(job, folder, **options):
    (path,) = build_named("to", "psd", options).write(job, folder)
    return path


def layers_in(path):
    """The layers of a file as psd-tools reads them, the lowest first, as names and pixels in [0, 1] on the canvas."""
    layers = []
    for layer in PSDImage.open(path):
        pixels = np.zeros((*SIZE, 4))
        pixels[layer.top : layer.bottom, layer.left : layer.right] = np.asarray(layer.topil(), float) / 255
        layers.append((layer.name, pixels))
    return layers


@pytest.mark.parametrize("case", CASES)
def test_layers_show_the_painting_and_readers_of_none_find_it(tmp_path, case):
    job = job_of(**CASES[case])
    path = written(job, tmp_path, layers=4, dpi=200.0)
    layers = layers_in(path)
    names = ["ground", "3 strokes", "3 strokes", "3 strokes", "2 strokes"] + ["light and paper"] * (case != "plain")
    assert [name.split(",")[0] for name, _ in layers] == names
    assert np.abs(shown(layers) - job.picture()).max() <= 2.5
    with Image.open(path) as merged:
        assert merged.mode == "RGB"
        assert np.array_equal(np.asarray(merged), job.picture())
        profile = ImageCms.ImageCmsProfile(BytesIO(merged.info["icc_profile"]))
        assert "sRGB" in ImageCms.getProfileName(profile)
    image = PSDImage.open(path)
    assert not any(layer.has_mask() for layer in image)
    assert image.image_resources.get_data(Resource.RESOLUTION_INFO).horizontal == 200 * 2**16


def test_a_transparent_painting_stays_so(tmp_path):
    alpha = torch.zeros(SIZE, dtype=torch.uint8)
    alpha[:, 20:] = 255
    job = job_of()
    path = written(replace(job, saved=replace(job.saved, alpha=alpha)), tmp_path)
    assert all((pixels[:, :19, 3] == 0).all() for _, pixels in layers_in(path))
    image = PSDImage.open(path)
    with Image.open(path) as pillows:
        for merged in (np.asarray(pillows), np.asarray(image.topil())):
            assert np.array_equal(merged[..., 3] > 127, alpha.numpy() > 127)
            assert np.abs(merged[:, 21:, :3] - job.picture()[:, 21:].astype(int)).max() <= 1


def test_a_painting_without_strokes_is_its_ground_and_one_too_large_is_refused(tmp_path):
    job = job_of()
    bare = replace(job, saved=replace(job.saved, strokes=job.strokes[:0], depth=job.saved.depth[:0]))
    ((name, pixels),) = layers_in(written(bare, tmp_path))
    assert name == "ground"
    assert pixels[0, 0].tolist() == pytest.approx([0.9, 0.8, 0.7, 1], abs=0.003)
    wide = replace(job, saved=replace(job.saved, size=(2, 30_001)))
    refuses(r"30000 pixels a side.* to=ora", written, wide, tmp_path)


TYPES = {5126: np.float32, 5123: np.uint16, 5125: np.uint32}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


def scene_of(path):
    """The description in a file, and a function that reads numbers by their accessor."""
    data = path.read_bytes()
    assert struct.unpack("<4sII", data[:12]) == (b"glTF", 2, len(data))
    length, kind = struct.unpack("<I4s", data[12:20])
    assert kind == b"JSON"
    scene, rest = json.loads(data[20 : 20 + length]), data[20 + length :]
    assert struct.unpack("<I4s", rest[:8]) == (len(rest) - 8, b"BIN\0")

    def numbers(accessor):
        reader = scene["accessors"][accessor]
        view = scene["bufferViews"][reader["bufferView"]]
        kind, width = TYPES[reader["componentType"]], WIDTHS[reader["type"]]
        return np.frombuffer(rest[8:], kind, reader["count"] * width, view["byteOffset"]).reshape(-1, width)

    return scene, numbers


def meshes_of(path):
    """Name, columns and triangles of each mesh."""
    scene, numbers = scene_of(path)
    for mesh in scene["meshes"]:
        (part,) = mesh["primitives"]
        columns = {name: numbers(at) for name, at in part["attributes"].items()}
        yield mesh["name"], columns, numbers(part["indices"]).reshape(-1, 3)


def opaque_job():
    job = job_of()
    strokes = replace(job.strokes, opacity=torch.ones(N), width=job.strokes.width.clamp_min(0.3))
    return replace(job, saved=replace(job.saved, strokes=strokes))


def seen_from_the_front(path, size, unit):
    """Colours (H, W, 3) in linear RGB of what is uppermost at the middle of each pixel; NaN for the ground."""
    y, x = np.mgrid[: size[0], : size[1]] + 0.5
    place = np.stack([x - size[1] / 2, size[0] / 2 - y], -1) * unit
    height, color = np.full(size, 0.0), np.full((*size, 3), np.nan)
    for name, columns, triangles in meshes_of(path):
        if name == "ground":
            continue
        for corners in triangles:
            a, b, c = columns["POSITION"][corners].astype(float)
            edges = np.stack([b - a, c - a], 1)[:2]
            if abs(np.linalg.det(edges)) < 1e-12:
                continue
            share = (place - a[:2]) @ np.linalg.inv(edges).T
            inside = (share >= 0).all(-1) & (share.sum(-1) <= 1)
            z = a[2] + share @ np.array([b[2] - a[2], c[2] - a[2]])
            above = inside & (z > height)
            height[above] = z[above]
            color[above] = columns["COLOR_0"][corners[0], :3] / 65535
    return color


def test_from_the_front_strokes_look_as_the_painting_does(tmp_path):
    job = opaque_job().scaled(8)
    (path,) = build_named("to", "gltf", {"size_cm": 40.0}).write(job, tmp_path)
    color = seen_from_the_front(path, job.size, 0.4 / max(job.size))
    painted = torch.from_numpy(job.picture()) / 255
    linear = build_named("color", "linear", {}).encode(painted.reshape(-1, 3)).reshape(painted.shape).numpy()
    wrong = np.abs(color - linear).max(-1) > 0.02
    assert (~np.isnan(color[..., 0])).mean() > 0.4
    assert wrong[~np.isnan(color[..., 0])].mean() < 0.05  # soft edges
    ground = np.array([0.9, 0.8, 0.7])
    bare = np.abs(painted.numpy() - ground).max(-1) < 0.01
    assert np.isnan(color[..., 0])[bare].mean() > 0.98


def test_strokes_appear_in_their_order_and_stay_on_the_canvas(tmp_path):
    job = opaque_job()
    (path,) = build_named("to", "gltf", {"seconds": 5.0, "thickness": 2.0}).write(job, tmp_path)
    scene, numbers = scene_of(path)
    (animation,) = scene["animations"]
    assert {channel["target"]["path"] for channel in animation["channels"]} == {"scale"}
    seconds = {
        channel["target"]["node"]: float(numbers(animation["samplers"][channel["sampler"]]["input"])[1, 0])
        for channel in animation["channels"]
    }
    names = [node["name"] for node in scene["nodes"]]
    assert names[0] == "ground"
    for node, second in seconds.items():
        first = int(names[node].split()[1])
        assert second == pytest.approx(5 * (first - 1) / N)
    for (_, columns, triangles), mesh in zip(meshes_of(path), scene["meshes"], strict=True):
        reader = scene["accessors"][mesh["primitives"][0]["attributes"]["POSITION"]]
        place = columns["POSITION"]
        assert (place.min(0).tolist(), place.max(0).tolist()) == (reader["min"], reader["max"])
        assert (np.abs(place[:, :2]) <= 0.5 * np.array([1, SIZE[0] / SIZE[1]]) + 1e-6).all()
        assert np.linalg.norm(columns["NORMAL"], axis=1) == pytest.approx(np.ones(len(place)), abs=1e-5)
        assert triangles.max() < len(place)
        if "_TIME" in columns:
            assert 0 <= columns["_TIME"].min() <= columns["_TIME"].max() <= 5
            assert columns["_WIDTH"].max() <= 2 * job.strokes.scale.max() / max(SIZE)


def test_a_painting_without_strokes_is_its_ground_and_too_many_are_refused(tmp_path):
    job = job_of()
    bare = replace(job, saved=replace(job.saved, strokes=job.strokes[:0], depth=job.saved.depth[:0]))
    exporter = build_named("to", "gltf", {})
    ((name, columns, triangles),) = meshes_of(exporter.write(bare, tmp_path)[0])
    assert (name, len(triangles)) == ("ground", 2)
    assert np.ptp(columns["POSITION"], axis=0).tolist() == pytest.approx([1, SIZE[0] / SIZE[1], 0])
    refuses("3000000; try to=svg", exporter.check, 3_000_000, SIZE)


def painted_thickly(n, size):
    strokes = random_strokes(n, size, width=(0.2, 0.5))
    return of_catalogue(replace(strokes, opacity=0.3 + 0.7 * strokes.opacity), size)


@pytest.mark.parametrize(("depth", "thick_as"), [(2.0, 2.0), (0.0, 1.0)])
def test_the_three_files_agree_with_the_heights(depth, thick_as, tmp_path, caplog):
    job = replace(painted_thickly(20, (21, 34)), light=Light(200, 30, depth))
    with caplog.at_level(logging.INFO, logger="brushexp_prints.relief"):
        paths = Relief().write(job, tmp_path)
    assert [path.name for path in paths] == ["relief.png", "height.png", "normals.png"]
    height = job.height()
    with Image.open(tmp_path / "height.png") as image:
        levels, text = np.asarray(image), image.text
    assert levels.max() == 65535
    white = float(text["HeightOfWhite"])
    assert white == pytest.approx(thick_as * height.max(), rel=1e-6)
    assert f"{white:.6g} pixels above the bare canvas" in text["Description"]
    assert f"{white:.6g} pixels above the bare canvas" in caplog.text
    np.testing.assert_allclose(levels * (white / 65535), thick_as * height, atol=white / 65535)
    with Image.open(tmp_path / "normals.png") as image:
        assert image.mode == "RGB"
        normals = np.asarray(image) / 127.5 - 1
    np.testing.assert_allclose(normals.transpose(2, 0, 1), normals_of(height, thick_as), atol=0.006)
    picture = next(replace(job, light=Light()).bands())[1].numpy()
    lit = pixels_of(tmp_path / "relief.png") / 255
    expected = shade_picture(picture, normals_of(height, thick_as), Light(200, 30))
    np.testing.assert_allclose(lit.transpose(2, 0, 1), expected, atol=0.003)


def test_files_are_the_same_in_bands(tmp_path, monkeypatch):
    job = painted_thickly(20, (40, 23))
    for name, pixels in (("whole", 2**20), ("bands", 23 * 7)):
        monkeypatch.setattr(banding, "BAND", pixels)
        (tmp_path / name).mkdir()
        Relief().write(job, tmp_path / name)
    for name, step in (("relief.png", 1), ("height.png", 8), ("normals.png", 1)):
        whole, parts = (np.asarray(Image.open(tmp_path / kind / name)).astype(int) for kind in ("whole", "bands"))
        assert np.abs(whole - parts).max() <= step


def painted(n: int = 40, size: tuple[int, int] = (36, 52), renderer=None, blend=None) -> ExportJob:
    background = torch.tensor([0.9, 0.5, 0.2])
    canvas = {"depth": torch.randperm(n), "background": background, "renderer": renderer, "blend": blend}
    return of_catalogue(random_strokes(n, size), size, **canvas)


def painted_at_once(job: ExportJob, share: np.ndarray) -> torch.Tensor:
    """This share of each stroke, the bottom one first, drawn directly."""
    n = int((share > 0).sum())
    with torch.no_grad():
        layers = job.renderer(cut_short(job.strokes[job.bottom_up[:n]], torch.from_numpy(share[:n]).float()))
        return job.blend(layers, torch.arange(n).flip(0), job.size, job.saved.background).image


def whole(job: ExportJob, counts: list[int]) -> list[np.ndarray]:
    """Shares of strokes that are there or not."""
    return [(np.arange(len(job.strokes)) < count).astype(float) for count in counts]


def test_in_the_light_and_in_another_colour_space_every_state_is_the_painting_of_its_strokes_in_bands_too(monkeypatch):
    job = replace(painted(renderer=build_named("renderer", "textured", {}).eval()), light=Light(depth=2.0))
    bare, half, last = (to_bytes(state) for state in states(job, whole(job, [0, 17, 40])))
    assert np.abs(last.astype(int) - job.picture()).max() <= 1
    assert np.abs(last.astype(int) - replace(job, light=Light()).picture()).max() > 8
    assert (bare == bare[0, 0]).all()
    assert np.abs(half.astype(int) - last).max() > 8
    job = replace(painted(), space=build_named("color", "pigment", {}))
    *_, last = states(job, whole(job, [0, 40]))
    torch.testing.assert_close(last, torch.cat([band for _, band in job.bands()], dim=1), atol=2e-3, rtol=0)
    job = painted(50, (200, 40), renderer=Windowed())
    unbanded = [picture.clone() for picture in states(job, whole(job, [10, 50]))]
    monkeypatch.setattr("brushexp.compositing.bands.BAND", 40 * 64)
    for picture, expected in zip(states(job, whole(job, [10, 50])), unbanded, strict=True):
        torch.testing.assert_close(picture, expected, rtol=0, atol=1e-5)


@pytest.mark.parametrize(("renderer", "blend"), [
    ("analytic", Tiled()), ("textured", Tiled()), ("neural", Tiled()),
    ("analytic", Tiled(kernel="torch")), ("analytic", Dense()), ("analytic", TopK(k=5)),
])  # fmt: skip
def test_each_state_is_the_painting_of_its_strokes_and_a_slow_blend_says_so(renderer, blend, caplog):
    job = painted(renderer=build_named("renderer", renderer, {}).eval(), blend=blend)
    shares = whole(job, [0, 1, 7, 7, 25, 40])
    for share, picture in zip(shares, states(job, shares), strict=True):
        torch.testing.assert_close(picture, painted_at_once(job, share), rtol=0, atol=2e-4)
    assert ("try blend=tiled" in caplog.text) == isinstance(blend, TopK)


def seen_at(strokes: Strokes, t: torch.Tensor) -> torch.Tensor:
    """Place, thickness and colour of each stroke at parameters t."""
    u = 2 * t[:, None] - 1
    thickness = half_width_of(strokes)[:, None] * (1 + strokes.widening[:, None] * u)
    return torch.cat([point_at(curve_of(strokes), t), thickness, strokes.color + drift_of(strokes) * u], 1)


def test_a_growing_stroke_is_a_part_of_it():
    strokes = with_shapes(random_strokes(5, (30, 40)))
    share = torch.tensor([1e-6, 0.3, 0.5, 0.9, 1.0])
    for point in torch.linspace(0, 1, 9)[:, None]:
        part = seen_at(cut_short(strokes, share), point.expand(5))
        torch.testing.assert_close(part, seen_at(strokes, point * share))
    assert torch.equal(cut_short(strokes, share).end[-1], strokes.end[-1])


def test_growing_strokes_have_no_more_than_their_renderer_draws():
    plain = painted(20, renderer=build_named("renderer", "textured", {}).eval())
    shaped = replace(plain, saved=replace(plain.saved, strokes=with_shapes(plain.strokes)))
    shares = [np.linspace(1.5, 0, 20).clip(0, 1)]
    assert torch.equal(*(next(states(job, shares)) for job in (plain, shaped)))


@pytest.mark.parametrize("blend", [Tiled(), TopK(k=5)])
def test_strokes_that_grow_lie_on_those_that_are_finished(blend):
    job = painted(20, blend=blend)
    share = np.concatenate([np.ones(15), [0.8, 0.5, 0.2], np.zeros(2)])
    shares = [np.zeros(20), share, np.ones(20)]
    for part, picture in zip(shares, states(job, shares), strict=True):
        torch.testing.assert_close(picture, painted_at_once(job, part), rtol=0, atol=2e-4)


@pytest.mark.parametrize("growing", [True, False])
@pytest.mark.parametrize("pace", ["even", "quickening"])
@pytest.mark.parametrize(("n", "frames"), [(0, 5), (1, 5), (1, 1), (7, 250), (5, 2)])
def test_the_canvas_is_bare_first_and_finished_last(n, frames, pace, growing):
    shares = list(schedule(n, frames, 3.0, pace, growing=growing))
    assert len(shares) == frames
    assert (shares[-1] == 1).all()
    assert frames == 1 or (shares[0] == 0).all()
    for before, after in pairwise(shares):
        assert (after >= before).all()
    for share in shares:
        assert share.shape == (n,)
        assert (np.diff(share) <= 0).all()
        assert growing or np.isin(share, [0, 1]).all()


def test_quickening_begins_slowly_and_long_canvases_are_drawn_at_the_size_of_the_film(tmp_path):
    even, quickening = (
        [share.sum() for share in schedule(1000, 101, 100.0, pace, growing=True)] for pace in ("even", "quickening")
    )
    np.testing.assert_allclose(np.diff(even[1:-1]), 10, atol=0.1)
    assert abs(quickening[10] - 10) < 1
    assert np.diff(quickening)[-2] > 18
    job = painted(20, (60, 1200))
    assert shrink_to_side(job, 4096) is job
    small = shrink_to_side(job, 480)
    assert small.size == (24, 480)
    (gif,) = Process(seconds=0.5, hold=0.0, format="gif").write(job, tmp_path)
    assert np.abs(unrolled(gif)[0][-1].astype(float) - small.picture()).mean() < 3


@pytest.mark.parametrize(("seconds", "fps", "hold"), [(1.0, 25, 0.2), (2.0, 10, 0.0), (0.5, 50, 0.3), (0.1, 1, 2.0)])
@pytest.mark.parametrize(("n", "size"), [(0, (36, 52)), (30, (33, 51)), (30, (1, 1)), (30, (1, 40))])
def test_films_begin_with_the_canvas_end_with_the_painting_and_are_as_long_as_was_asked(
    tmp_path, n, size, seconds, fps, hold
):
    job = painted(n, size)
    job = changed(job, strokes=replace(job.strokes, opacity=torch.ones(n)))
    count = max(1, round(seconds * fps)) + round(hold * fps)
    video, gif = Process(seconds=seconds, fps=fps, hold=hold, format="both").write(job, tmp_path)
    assert sorted(tmp_path.iterdir()) == [gif, video] == [tmp_path / "process.gif", tmp_path / "process.mp4"]
    (frames, rate), (pictures, durations) = decoded(video), unrolled(gif)
    assert (len(frames), rate) == (count, fps)
    assert abs(sum(durations) - 1000 * count / fps) <= 5
    height, width = size
    for film, rough in ((frames, 12), (pictures, 3)):  # a video has fewer colours than pixels
        assert max(film[0].shape[0] - height, film[0].shape[1] - width) <= 1
        first, last = (film[k][:height, :width].astype(float) for k in (0, -1))
        assert round(seconds * fps) < 2 or np.abs(first / 255 - job.saved.background.numpy()).max() < 0.03
        assert np.abs(last - job.picture()).mean() < rough


@pytest.mark.parametrize(("growing", "most"), [(None, 1), (False, 1), (True, 8)])
def test_a_slow_renderer_draws_each_stroke_once_unless_they_grow(tmp_path, growing, most):
    brush = Windowed()
    assert brush.warm_up is not None
    job = changed(painted(10, renderer=brush), strokes=random_strokes(200, (36, 52)), depth=torch.randperm(200).int())
    Process(seconds=2.0, hold=0.0, growing=growing).write(job, tmp_path)
    assert (most - 1) * 200 / 2 < brush.drawn <= 2 * most * 200, (
        "once for the paint, once for the light it lets through"
    )
