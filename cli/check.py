"""`coslobe check`: is a scene file right, and what is in it?"""

from collections.abc import Iterator
from typing import TYPE_CHECKING

from coslobe.cli.common import command, say
from coslobe.cli.options import SceneArgument

if TYPE_CHECKING:
    from coslobe.render.assets import Assets
    from coslobe.render.scene import Object, SceneFile


@command
def check(scene: SceneArgument) -> None:
    """Validate a scene file at all frames, read the files that it names, and print a summary."""
    from coslobe.render.assets import Assets
    from coslobe.render.scene import load_scene

    scene_file = load_scene(scene)
    for frame in range(scene_file.frames) if scene_file.tracks else ():
        scene_file.at(frame)
    for line in _summary(scene_file, Assets(None)):
        say(line)


def _summary(scene_file: "SceneFile", assets: "Assets") -> Iterator[str]:
    scene = scene_file.at(0)
    image, camera = scene.image, scene.camera
    seconds = scene_file.frames / scene_file.fps
    yield f"{scene_file.path}: valid"
    yield f"image      {image.width} x {image.height}, samples per pixel: {image.samples}"
    yield f"sequence   {scene_file.frames} frames at {scene_file.fps:g} per second, {seconds:.3g} s"
    look_at = camera.look_at
    yield f"camera     from {_vector(look_at.origin)} to {_vector(look_at.target)}, fov {camera.fov:g}"
    for name, light in scene.lights.items():
        sphere = light.sphere
        yield f"light      {name}: sphere of radius {sphere.radius:g} at {_vector(sphere.center)}"
    for name, obj in scene.objects.items():
        yield f"object     {name}: {_described(obj, assets)}, material {obj.material}"
    for track in scene_file.tracks:
        path = ".".join(map(str, track.path))
        yield f"animation  {path}: {len(track.frames)} keys, frames {track.frames[0]} to {track.frames[-1]}"


def _described(obj: "Object", assets: "Assets") -> str:
    if obj.plane is not None:
        return f"plane of size {obj.plane.size:g}"
    mesh = assets.mesh(obj)
    size = f"{obj.mesh}, {len(mesh.vertices):,} vertices, {len(mesh.faces):,} triangles"
    if not obj.occludes:
        return f"{size}, does not occlude"
    count = obj.spheres.count if obj.spheres.file is None else len(assets.spheres(obj).radii)
    return f"{size}, {count} spheres"


def _vector(values: tuple[float, ...]) -> str:
    return f"({', '.join(f'{value:g}' for value in values)})"
