"""Render a ``painting.glb`` written by ``to=gltf`` from the front and the side in Blender (``pip install bpy``).

python benchmarks/blender.py outputs/x/painting.glb sheet.png --frame 250 --pixels 480
"""

import argparse
import tempfile
from math import radians
from pathlib import Path

import bpy
from mathutils import Vector
from PIL import Image

VIEWS = (((0, -1.6, 0), (0, 0, 0)), ((0.42, -0.3, -0.28), (0.12, 0, 0)))  # positions of the camera and of its target


def main() -> None:
    """Render a painting from the front and from the side, and write the two views as one sheet."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("painting", type=Path)
    parser.add_argument("sheet", type=Path)
    parser.add_argument("--frame", type=int, help="of the animation; the last by default")
    parser.add_argument("--pixels", type=int, default=480)
    options = parser.parse_args()
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=str(options.painting))
    scene = bpy.context.scene
    scene.frame_set(scene.frame_end + 1 if options.frame is None else options.frame)
    scene.render.engine, scene.cycles.samples, scene.cycles.transparent_max_bounces = "CYCLES", 32, 64
    scene.view_settings.view_transform = "Standard"
    scene.render.resolution_x = scene.render.resolution_y = options.pixels
    scene.world = bpy.data.worlds.new("grey")
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.6, 0.6, 0.6, 1)
    sun = add_to_scene(bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN")))
    sun.data.energy, sun.rotation_euler = 3, (radians(50), 0, radians(-40))
    camera = scene.camera = add_to_scene(bpy.data.objects.new("camera", bpy.data.cameras.new("camera")))
    camera.data.clip_start = 0.01
    sheet = Image.new("RGB", (len(VIEWS) * options.pixels, options.pixels))
    with tempfile.TemporaryDirectory() as folder:
        for number, (place, goal) in enumerate(VIEWS):
            camera.location = place
            camera.rotation_euler = (Vector(goal) - Vector(place)).to_track_quat("-Z", "Y").to_euler()
            scene.render.filepath = str(Path(folder, f"{number}.png"))
            bpy.ops.render.render(write_still=True)
            with Image.open(scene.render.filepath) as view:
                sheet.paste(view.convert("RGB"), (number * options.pixels, 0))
    sheet.save(options.sheet)


def add_to_scene(thing: bpy.types.Object) -> bpy.types.Object:
    """Add an object to the scene and return it."""
    bpy.context.scene.collection.objects.link(thing)
    return thing


if __name__ == "__main__":
    main()
