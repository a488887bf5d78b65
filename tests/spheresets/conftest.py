"""Meshes with known geometry, and one device for what does not depend on which."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from coslobe.core.device import Device, open_device
from coslobe.spheresets.mesh import Mesh, angle_weighted_normals


@pytest.fixture(scope="session")
def one_device() -> Device:
    """The device that commands choose by themselves."""
    return open_device()


@pytest.fixture(scope="session")
def mesh_of():
    """Makes a Mesh from trimesh objects."""

    def make(*parts: trimesh.Trimesh, file: str = "test.ply") -> Mesh:
        whole = trimesh.util.concatenate(parts)
        vertices, faces = np.array(whole.vertices, np.float64), np.array(whole.faces, np.int32)
        return Mesh(vertices, faces, angle_weighted_normals(vertices, faces), file, "0" * 64)

    return make


@pytest.fixture(scope="session")
def ball(mesh_of) -> Mesh:
    """A unit ball in 5,120 triangles; its volume is 0.3 % too small."""
    return mesh_of(trimesh.creation.icosphere(subdivisions=4))


@pytest.fixture
def ball_file(tmp_path: Path) -> Path:
    """A ball as a PLY file, small enough to fit in a moment."""
    path = tmp_path / "ball.ply"
    trimesh.creation.icosphere(subdivisions=3).export(path)
    return path
