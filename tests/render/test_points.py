"""Points made on the device, against those of the host."""

import numpy as np
import pytest

from coslobe.render import layout
from coslobe.render.assets import Assets
from coslobe.render.camera import Part, bands
from coslobe.render.points import PointBuffers, pack_points
from coslobe.render.scene import load_scene
from coslobe.render.visible import Viewer

WHOLE = [layout.POINT_ROWS.index(name) for name in ("material", "object")]
NUMBERS = [row for row in range(len(layout.POINT_ROWS)) if row not in WHOLE]
SIZE = ["image.width=70", "image.height=50"]


def visible(path, *changes, part=None, frame=2):
    scene = load_scene(path, [*SIZE, *changes]).at(frame)
    return Viewer(Assets(None)).visible(scene, part or Part(0, 70 * 50))


def on_device(device, points):
    material = np.arange(len(points), dtype=np.int32)[::-1].copy()
    buffer, origin, launches = PointBuffers(device).upload(points, material)
    assert bool(launches) == device.has_doubles
    assert all(launch.seconds > 0 for launch in launches)
    rows = (len(layout.POINT_ROWS), layout.padded(len(points)))
    made = device.download(buffer, rows, np.float32)
    return made, pack_points(points.gbuffer, material, origin)


@pytest.mark.parametrize(
    "changes",
    [
        [],
        ["image.samples=4", "objects.cube.normals=flat"],
        ["image.samples=3", "camera.fov_axis=y", "camera.fov=70"],
        [
            "objects.ground.plane.size=90",
            "camera.look_at.origin=[-1, 0.05, 1.5]",
        ],  # the plane fills the picture
        ["objects.ground.transform={rotate_x: 160}"],  # seen from below
        ["objects.cube.transform={scale: 0.3, rotate_x: 20, translate: [0.2, 0.3, -0.1]}"],
        ["objects.cube.visible=false"],
        [
            "objects.cube.transform.translate=[1e5, 0, 0]",
            "objects.ground.transform.translate=[1e5, 0, 0]",
            "camera.look_at={origin: [99999, 1.2, 1.5], target: [100000, 0.2, 0]}",
        ],
    ],
)
def test_the_device_makes_the_points_that_the_host_packs(tiny_scene, device, changes):
    made, expected = on_device(device, visible(tiny_scene, *changes))
    assert made.shape[1] > 200
    np.testing.assert_array_equal(made[WHOLE].view(np.int32), expected[WHOLE].view(np.int32))
    # Both compute in float64 and round once; 1e-11 of the coordinates before the origin is subtracted.
    scale = 1e-11 * (1e5 if "1e5" in str(changes) else 1)
    np.testing.assert_allclose(made[NUMBERS], expected[NUMBERS], rtol=2e-7, atol=scale)


def test_parts_make_the_points_of_the_whole(tiny_scene, device):
    whole, _ = on_device(device, visible(tiny_scene))
    scene = load_scene(tiny_scene, SIZE).at(2)
    pieces = [visible(tiny_scene, part=part) for part in bands(scene.image, 1000)]
    parts = [on_device(device, piece)[0][:, : len(piece)] for piece in pieces]
    assert len(parts) > 3
    kept = [row for row, name in enumerate(layout.POINT_ROWS) if name != "material"]  # numbered part by part
    found, expected = np.concatenate(parts, axis=1)[kept], whole[kept, : sum(map(len, pieces))]
    np.testing.assert_array_equal(found.view(np.int32), expected.view(np.int32))


def test_devices_without_double_precision_get_the_hosts_points(tiny_scene, device, monkeypatch):
    monkeypatch.setattr(type(device), "has_doubles", False)
    made, expected = on_device(device, visible(tiny_scene))
    np.testing.assert_array_equal(made.view(np.int32), expected.view(np.int32))


def test_points_stay_on_the_device_until_they_or_their_materials_change(tiny_scene, device):
    buffers = PointBuffers(device)
    one, other = visible(tiny_scene), visible(tiny_scene, frame=0)
    material = one.material
    first = buffers.upload(one, material)
    assert buffers.upload(one, material.copy())[0] is first[0]
    assert buffers.upload(one, material.copy())[2] == []
    assert buffers.upload(one, material + 1)[0] is not first[0]
    assert buffers.upload(other, other.material)[0] is not first[0]


def test_the_origin_lies_amid_the_points(tiny_scene):
    near = visible(tiny_scene)
    spread = np.linalg.norm(near.gbuffer.position - near.gbuffer.position.mean(axis=0), axis=1).max()
    assert np.linalg.norm(near.origin - np.median(near.gbuffer.position, axis=0)) < spread / 4
    nothing = visible(tiny_scene, "camera.look_at.target=[-5, 9, 1.5]")
    assert len(nothing) == 0
    np.testing.assert_array_equal(nothing.origin, [-1, 1.2, 1.5])
