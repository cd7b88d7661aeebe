"""Export the painting as a 3-D model (glTF 2.0, the Khronos Group, 2021) for Blender and similar programs."""

import json
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import torch

from brushexp.contracts import UserError, above, between, build_named, register
from brushexp.contracts.families import Exporter, ExportJob
from brushexp.contracts.files import replacing
from brushexp_exports.ribbons import ACROSS, POINTS, TRIANGLES, Ribbons, ribbons_of, triangles_of

LARGEST_FILE = 2**32  # bytes; the format stores lengths in 32 bits
ANIMATION_STEPS = 100  # groups of strokes that appear one after another in the animation
FLOAT, SHORT, INT = 5126, 5123, 5125  # glTF's codes for component types
VERTICES, CORNERS = 34962, 34963  # glTF's codes for buffer targets
COMPONENTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
PER_STROKE = POINTS * (4 * (3 + 3 + 2 + 1 + 1) + 2 * 4) + TRIANGLES * 3 * 4  # bytes
Array = np.ndarray


@register("to", "gltf")
@dataclass(kw_only=True)
class Gltf(Exporter):
    """Writes ``painting.glb``: each stroke as a ribbon of paint in 3-D, for Blender, Godot, three.js and model viewers.

    The painting is upright, strokes are stacked on top of each other, and an animation adds them from bottom to top.
    Ribbons have plain colours without texture, light or paper. Vertices have extra attributes for your own shaders:
    ``UV`` (0 to 1 along and across a stroke), ``_TIME`` (time in seconds at which the brush passes) and ``_WIDTH`` (in
    metres).

    Args:
        size_cm: longer side of the canvas in cm.
        thickness: thickness of a stroke's paint, in thousandths of the longer side.
        seconds: duration of the animation in seconds.
    """

    size_cm: Annotated[float, above(0, 100_000)] = 100.0
    thickness: Annotated[float, between(0, 100)] = 0.5
    seconds: Annotated[float, above(0, 3600)] = 10.0

    def check(self, count: int, size: tuple[int, int]) -> None:
        if PER_STROKE * count > LARGEST_FILE:
            most = LARGEST_FILE // PER_STROKE
            raise UserError(f"to=gltf holds {most} strokes, but this painting has {count}; try to=svg")

    def write(self, job: ExportJob, folder: Path) -> list[Path]:
        ribbons = ribbons_of(job, self.thickness / 1000 * max(job.size))
        file = _Glb()
        file.add_canvas(job, unit := self.size_cm / 100 / max(job.size))
        if len(ribbons.number):
            self._add_strokes(file, ribbons, len(job.strokes), unit)
        with replacing(folder / "painting.glb") as temporary:
            temporary.write_bytes(file.pack())
        return [folder / "painting.glb"]

    def _add_strokes(self, file: "_Glb", ribbons: Ribbons, count: int, unit: float) -> None:
        """Add the strokes in groups that appear one after another in the animation."""
        shape = ribbons.points.shape[:3]
        begin = ribbons.number[:, None] + ribbons.along
        columns = {
            "POSITION": unit * ribbons.points,
            "NORMAL": ribbons.normals,
            "COLOR_0": light_of(ribbons)[:, :, None],
            "TEXCOORD_0": np.stack(np.broadcast_arrays(ribbons.along[:, None], np.linspace(0, 1, ACROSS)), -1),
            "_TIME": self.seconds / max(count, 1) * begin[..., None, None],
            "_WIDTH": unit * ribbons.width[..., None, None],
        }
        columns = {name: np.broadcast_to(value, (*shape, value.shape[-1])) for name, value in columns.items()}
        paint = file.add_material("paint", (1, 1, 1), opaque=bool((ribbons.opacity > 1 - 1e-3).all()))
        for part in np.array_split(np.arange(len(ribbons.number)), min(ANIMATION_STEPS, len(ribbons.number))):
            first, last = ribbons.number[part[[0, -1]]]
            node = file.add_mesh(
                f"strokes {first + 1} to {last + 1}",
                {name: value[part].reshape(len(part) * POINTS, -1) for name, value in columns.items()},
                triangles_of(len(part)),
                paint,
            )
            if second := self.seconds * first / count:
                file.add_appearance(node, second)


def light_of(ribbons: Ribbons) -> Array:
    """Return the ribbons' linear RGB and opacity (N, S, 4) as 16-bit integers."""
    color = build_named("color", "linear", {}).encode(torch.from_numpy(ribbons.color)).numpy()
    opacity = np.broadcast_to(ribbons.opacity[:, None, None], (*color.shape[:2], 1))
    return np.rint(65535 * np.concatenate([color, opacity], 2).clip(0, 1)).astype(np.uint16)


class _Glb:
    """Collects the description of a scene and the binary data to which it refers."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.scene: dict[str, list[Any]] = {
            name: [] for name in ("nodes", "meshes", "materials", "accessors", "bufferViews")
        }
        self.sampler: list[dict[str, Any]] = []
        self.channels: list[dict[str, Any]] = []

    def add_canvas(self, job: ExportJob, unit: float) -> None:
        """Add the bare canvas in the colour of the ground."""
        y, x = (0.5 * unit * side for side in job.size)
        points = np.array([[-x, -y, 0], [x, -y, 0], [x, y, 0], [-x, y, 0]])
        columns = {"POSITION": points, "NORMAL": np.tile([0.0, 0.0, 1.0], (4, 1))}
        space = build_named("color", "linear", {})
        ground = space.encode(job.saved.background.cpu().double()[None])[0].tolist()
        self.add_mesh("ground", columns, np.array([[0, 1, 2], [0, 2, 3]]), self.add_material("ground", ground))

    def add_material(self, name: str, color: Any, *, opaque: bool = True) -> int:
        """Add a matt material with a linear RGB colour that multiplies vertex colours; return its index."""
        paint = {"baseColorFactor": [*color, 1], "metallicFactor": 0, "roughnessFactor": 0.6}
        mode = {} if opaque else {"alphaMode": "BLEND"}
        self.scene["materials"].append({"name": name, "pbrMetallicRoughness": paint, "doubleSided": True} | mode)
        return len(self.scene["materials"]) - 1

    def add_mesh(self, name: str, columns: dict[str, Array], corners: Array, material: int) -> int:
        """Add a mesh with vertex attributes (P, k) and triangle corners (T, 3); return the index of its node."""
        attributes = {key: self._add(value, VERTICES, bounds=key == "POSITION") for key, value in columns.items()}
        indices = self._add(corners.reshape(-1, 1).astype(np.uint32), CORNERS)
        primitive = {"attributes": attributes, "indices": indices, "material": material}
        self.scene["meshes"].append({"name": name, "primitives": [primitive]})
        self.scene["nodes"].append({"name": name, "mesh": len(self.scene["meshes"]) - 1})
        return len(self.scene["nodes"]) - 1

    def add_appearance(self, node: int, second: float) -> None:
        """Hide a node until ``second`` of the animation by scaling it to 0."""
        times = self._add(np.array([[0.0], [second]]), bounds=True)
        sizes = self._add(np.array([[0.0] * 3, [1.0] * 3]))
        self.sampler.append({"input": times, "output": sizes, "interpolation": "STEP"})
        self.channels.append({"sampler": len(self.sampler) - 1, "target": {"node": node, "path": "scale"}})

    def pack(self) -> bytes:
        """Return the scene as the bytes of a .glb file."""
        document: dict[str, Any] = {"asset": {"version": "2.0", "generator": "brushexp"}, "scene": 0}
        document |= {"scenes": [{"nodes": [*range(len(self.scene["nodes"]))]}], **self.scene}
        document["buffers"] = [{"byteLength": len(self.data)}]
        if self.channels:
            document["animations"] = [{"name": "painting", "samplers": self.sampler, "channels": self.channels}]
        text = json.dumps(document, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        parts = [(b"JSON", text), (b"BIN\0", bytes(self.data))]
        body = b"".join(struct.pack("<I", len(part)) + kind + part for kind, part in parts)
        return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body

    def _add(self, values: Array, target: int | None = None, *, bounds: bool = False) -> int:
        """Add numbers (n, k), stored as uint16, uint32 or float32; return the index of their accessor."""
        kinds = {np.dtype(np.uint16): SHORT, np.dtype(np.uint32): INT}
        values = values if values.dtype in kinds else values.astype(np.float32)
        data = np.ascontiguousarray(values).tobytes()
        view = {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data)}
        self.scene["bufferViews"].append(view | ({} if target is None else {"target": target}))
        self.data += data + bytes(-len(data) % 4)
        size = next(name for name, width in COMPONENTS.items() if width == values.shape[1])
        reader = {"bufferView": len(self.scene["bufferViews"]) - 1, "count": len(values), "type": size}
        reader["componentType"] = kinds.get(values.dtype, FLOAT)
        if reader["componentType"] == SHORT:
            reader["normalized"] = True
        if bounds:
            reader |= {"min": values.min(0).tolist(), "max": values.max(0).tolist()}
        self.scene["accessors"].append(reader)
        return len(self.scene["accessors"]) - 1
