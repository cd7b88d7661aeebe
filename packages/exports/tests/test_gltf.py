"""Test that glTF files are well formed, and that their strokes look like the painting when seen from the front."""

import json
import struct
from dataclasses import replace

import numpy as np
import pytest
import torch
from refusals import refuses
from test_ora import SIZE, N, job_of

from brushexp.registry import build_named

TYPES = {5126: np.float32, 5123: np.uint16, 5125: np.uint32}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


def scene_of(path):
    """Return a file's JSON description, and a function that reads an accessor's values."""
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
    """Yield the name, vertex attributes and triangles of each mesh."""
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
    """Return the linear RGB (H, W, 3) of the top stroke at each pixel's centre, or NaN where the ground is visible."""
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
    assert wrong[~np.isnan(color[..., 0])].mean() < 0.05  # only soft edges differ
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
    again = build_named("to", "gltf", {"seconds": 5.0, "thickness": 2.0}).write(job, tmp_path / "..")[0]
    assert again.read_bytes() == path.read_bytes()


def test_a_painting_without_strokes_is_its_ground_and_too_many_are_refused(tmp_path):
    job = job_of()
    bare = replace(job, saved=replace(job.saved, strokes=job.strokes[:0], depth=job.saved.depth[:0]))
    exporter = build_named("to", "gltf", {})
    ((name, columns, triangles),) = meshes_of(exporter.write(bare, tmp_path)[0])
    assert (name, len(triangles)) == ("ground", 2)
    assert np.ptp(columns["POSITION"], axis=0).tolist() == pytest.approx([1, SIZE[0] / SIZE[1], 0])
    refuses("3000000; try to=svg", exporter.check, 3_000_000, SIZE)
