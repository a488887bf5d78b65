"""Meshes as users have them: what is found, what is said, and that the inside is right all the same."""

from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from coslobe.core.errors import InvalidInput
from coslobe.core.progress import Progress
from coslobe.spheresets.fit import fit_spheres
from coslobe.spheresets.mesh import load_mesh
from coslobe.spheresets.orientation import coincident, study
from coslobe.spheresets.samples import draw_points
from coslobe.spheresets.settings import FitSettings
from coslobe.spheresets.solid import Solid

BALL = trimesh.creation.icosphere(subdivisions=4)  # 5,120 triangles; its volume is 0.3 % below the ball's
CHANCE = np.random.default_rng(0).random(len(BALL.faces))
WAY = "; inside by winding number"


def mesh(vertices, faces) -> trimesh.Trimesh:
    return trimesh.Trimesh(np.asarray(vertices, float), faces, process=False)


def flipped(part, which: Any = slice(None)):
    faces = part.faces.copy()
    faces[which] = faces[which][:, ::-1]
    return mesh(part.vertices, faces)


def kept(part, which):
    return mesh(part.vertices, part.faces[which])


def moved(part, x: float, scale: float = 1.0):
    return mesh(part.vertices * scale + [x, 0, 0], part.faces)


def joined(*parts):
    return trimesh.util.concatenate(parts)


def soup(part):
    """Every triangle with vertices of its own."""
    return mesh(part.vertices[part.faces].reshape(-1, 3), np.arange(3 * len(part.faces)).reshape(-1, 3))


def patches(part):
    """Eight octants with cracks between them, every second one turned inwards."""
    octant = (part.triangles_center > 0) @ [1, 2, 4]
    whole = soup(flipped(part, octant % 2 == 0))
    whole.vertices += 1e-6 * np.repeat(octant, 3)[:, None]
    return whole


def with_triangle(part, *corners):
    n = len(part.vertices)
    return mesh(np.concatenate([part.vertices, corners]), np.concatenate([part.faces, [[n, n + 1, n + 2]]]))


def in_ball(points, x=0.0, radius=1.0):
    return np.linalg.norm(points - [x, 0, 0], axis=1) < radius


def in_hollow(points):
    return in_ball(points) & ~in_ball(points, radius=0.5)


def in_two(points):
    return in_ball(points, -0.4) | in_ball(points, 0.4)


TWO = moved(BALL, -0.4), moved(BALL, 0.4)
FAR = moved(BALL, -2), moved(BALL, 2)
HALF = moved(BALL, 0, 0.5)
PLATE = mesh([[-1, -1, 2], [1, -1, 2], [1, 1, 2], [-1, 1, 2]], [[0, 1, 2], [0, 2, 3]])

# Defect: mesh, what is said, what is inside, share of random points in the box that have to agree.
DEFECTS = {
    "none": (BALL, "", in_ball, 0.998),
    "inside out": (flipped(BALL), "inside out", in_ball, 0.998),
    "a fifth flipped": (
        flipped(BALL, CHANCE < 0.2), f"{(CHANCE < 0.2).sum():,} triangles turned over", in_ball, 0.998
    ),
    "a half flipped": (flipped(BALL, BALL.triangles_center[:, 0] > 0), "turned over", in_ball, 0.998),
    "a twentieth missing": (kept(BALL, CHANCE > 0.05), "holes", in_ball, 0.995),
    "a hole": (kept(BALL, np.arange(5120) > 0), "1 hole", in_ball, 0.998),
    "missing and flipped": (
        kept(flipped(BALL, CHANCE < 0.3), CHANCE > 0.05), "triangles turned over", in_ball, 0.995
    ),
    "triangle soup": (soup(BALL), "12,798 duplicate vertices merged", in_ball, 0.998),
    "cracked patches, some flipped": (patches(BALL), "8 shells", in_ball, 0.998),
    "triangles twice": (joined(BALL, BALL), "useless triangles left out", in_ball, 0.998),
    "triangles back to back": (
        mesh(BALL.vertices, np.concatenate([BALL.faces, flipped(BALL).faces])),
        "5,120 useless triangles left out", in_ball, 0.998,
    ),
    "useless triangles": (
        mesh(BALL.vertices, np.concatenate([BALL.faces, [[0, 0, 1], [5, 5, 5]]])),
        "2 useless triangles left out", in_ball, 0.998,
    ),
    "unused vertices": (mesh(np.concatenate([BALL.vertices, [[9, 9, 9]]]), BALL.faces), "", in_ball, 0.998),
    "three triangles at an edge": (
        mesh(np.r_[BALL.vertices, [[0, 0, 0]]], np.r_[BALL.faces, [[*BALL.edges[0], 2562]]]),
        "1 edge with more than two triangles", in_ball, 0.995,
    ),
    "wall within": (
        with_triangle(BALL, [-0.8, 0, 0], [0.8, 0, 0], [0, 0.8, 0]), "5% of the surface within the solid",
        in_ball, 0.99,
    ),
    "two shells": (joined(*FAR), "2 shells", lambda p: in_ball(p, -2) | in_ball(p, 2), 0.998),
    "overlapping shells": (joined(*TWO), "% of the surface within the solid", in_two, 0.997),
    "overlapping shells, one inside out": (
        joined(TWO[0], flipped(TWO[1])), "5,120 triangles turned over", in_two, 0.997
    ),
    "hollow": (joined(BALL, flipped(HALF)), "2 shells", in_hollow, 0.997),
    "hollow, inside out": (joined(flipped(BALL), HALF), "triangles turned over", in_hollow, 0.997),
    "hollow with holes": (
        kept(joined(BALL, flipped(HALF)), np.tile(CHANCE, 2) > 0.03), "holes", in_hollow, 0.99
    ),
    "nested the same way": (joined(BALL, HALF), "20% of the surface within the solid", in_ball, 0.998),
    "ball under a sheet": (joined(BALL, PLATE), "24% of the surface without thickness", in_ball, 0.99),
}  # fmt: skip


@pytest.mark.parametrize("defect", DEFECTS)
def test_defects_are_named_and_the_inside_is_right(defect, mesh_of):
    part, said, truth, least = DEFECTS[defect]
    solid = Solid(mesh_of(part))
    if said:
        assert solid.report.startswith("test.ply: ")
        assert said in solid.report
        assert solid.report.endswith(WAY)
    else:
        assert solid.report == ""
    points = np.random.default_rng(1).uniform(solid.lower, solid.upper, (10_000, 3)) * 1.1
    assert (solid.inside(points) == truth(points * solid.size + solid.center)).mean() > least
    assert solid.encloses(points[solid.inside(points)])


EMPTY = {
    "one triangle": mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]),
    "sheet": PLATE,
    "sheet with two sides": mesh(PLATE.vertices, [*PLATE.faces, *flipped(PLATE).faces]),
}


@pytest.mark.parametrize("shape", EMPTY)
def test_meshes_without_volume_are_refused(shape, mesh_of):
    solid = Solid(mesh_of(EMPTY[shape], file="flat.ply"))
    with pytest.raises(InvalidInput, match=r"flat\.ply: the mesh encloses no volume") as caught:
        draw_points(solid, (0.0067, 0.02), 1, 1000, np.random.default_rng(0))
    assert caught.value.hint


def test_vertices_that_are_not_finite_cost_their_triangles(tmp_path):
    path = tmp_path / "ball.ply"
    vertices = BALL.vertices.copy()
    vertices[7] = np.nan
    mesh(vertices, BALL.faces).export(path)
    loaded = load_mesh(path)
    assert np.isfinite(loaded.vertices).all()
    assert len(loaded.vertices) == len(BALL.vertices)
    assert 0 < len(BALL.faces) - len(loaded.faces) <= 6
    assert Solid(loaded).report == f"{path}: 1 vertex not finite, left out with its triangles, 1 hole{WAY}"


def test_fits_say_what_they_found(mesh_of, one_device, monkeypatch):
    part = kept(flipped(BALL, CHANCE < 0.2), CHANCE > 0.01)
    lines, progress = [], Progress()
    monkeypatch.setattr(progress, "say", lines.append)
    tree = fit_spheres(mesh_of(part), FitSettings(1), device=one_device, progress=progress)
    assert any("holes" in line and "turned over" in line for line in lines)
    np.testing.assert_allclose(tree.finest.centers[0], 0, atol=0.02)
    assert tree.finest.radii[0] == pytest.approx(1, abs=0.02)


def test_sheets_beside_a_body_do_not_swell_its_spheres(mesh_of, one_device):
    """Without thickness they have no volume to fill, but all the silhouette that spheres are to match."""
    leaves = [mesh(PLATE.vertices * 0.3 + [x, 1.5, 0], PLATE.faces) for x in (-1.0, 0.0, 1.0)]
    whole = mesh_of(joined(BALL, *leaves))
    sheets = Solid(whole).sheets
    np.testing.assert_array_equal(sheets, np.arange(len(whole.faces)) >= len(BALL.faces))
    tree = fit_spheres(whole, FitSettings(1), device=one_device)
    np.testing.assert_allclose(tree.finest.centers[0], 0, atol=0.02)
    assert tree.finest.radii[0] == pytest.approx(1, abs=0.02)


def test_patches_that_enclose_together_are_no_sheets(mesh_of):
    assert not Solid(mesh_of(patches(BALL))).sheets.any()


@pytest.mark.parametrize("scale", [1e-9, 1e9])
@pytest.mark.parametrize("offset", [0.0, 1e6])
def test_neither_size_nor_place_matters(scale, offset, mesh_of):
    """Offsets are in units of the ball: 1e6 leaves 1e-10 of its radius to float64."""
    solid = Solid(mesh_of(mesh((BALL.vertices + offset) * scale, BALL.faces)))
    assert solid.report == ""
    points = np.random.default_rng(2).uniform(-0.3, 0.3, (2000, 3))
    radius = 1 / (2 * np.sqrt(3))
    wrong = solid.inside(points) != (np.linalg.norm(points, axis=1) < radius)
    assert wrong.mean() < 0.004  # between the ball and its triangles
    np.testing.assert_allclose(solid.center / scale, offset, rtol=1e-9, atol=1e-9)


def test_a_tetrahedron_is_a_solid(mesh_of):
    solid = Solid(
        mesh_of(
            mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
        )
    )
    points = np.random.default_rng(3).random((5000, 3))
    inside = solid.inside((points - solid.center) / solid.size)
    np.testing.assert_array_equal(inside, points.sum(1) < 1)


def test_a_one_sided_surface_is_turned_as_far_as_it_goes():
    """Neighbours of a Moebius strip cannot all agree; only those at one seam are left that do not."""
    n = 40
    angle, width = np.meshgrid(np.arange(n) * 2 * np.pi / n, [-0.3, 0.3])
    r = 1 + width * np.cos(angle / 2)
    strip = np.stack([r * np.cos(angle), r * np.sin(angle), width * np.sin(angle / 2)], -1).reshape(-1, 3)
    k = np.arange(n)
    after = (k + 1) % n
    low, high = np.where(k == n - 1, after + n, after), np.where(k == n - 1, after, after + n)
    faces = np.concatenate([np.stack([k, low, k + n], 1), np.stack([k + n, low, high], 1)]).astype(np.int32)
    faces[::3] = faces[::3, ::-1]
    found = study(strip, faces, np.ones(len(faces)))
    assert not found.closed
    assert found.holes == 1
    turned = np.where(found.turn[:, None] < 0, faces[:, ::-1], faces)
    ends = np.stack([turned, np.roll(turned, -1, 1)], -1).reshape(-1, 2)
    assert len(ends) - len(np.unique(ends, axis=0)) <= 1


def test_vertices_at_one_place_have_one_number():
    rng = np.random.default_rng(4)
    different = rng.integers(-2, 3, (300, 3)).astype(float)
    place, places = coincident(different * np.where(different == 0, -1.0, 1.0))  # -0 is 0
    unique, expected = np.unique(different, axis=0, return_inverse=True)
    assert places == len(unique)
    assert len(np.unique(np.stack([place, expected.reshape(-1)]), axis=1).T) == places


@settings(max_examples=100, deadline=None)
@given(st.lists(st.lists(st.integers(0, 7), min_size=3, max_size=3), min_size=1, max_size=20))
def test_any_triangles_have_an_inside_or_a_reason(mesh_of, faces):
    """Corners of a cube joined at random: every kind of crossing, doubling and degeneration."""
    corners = np.stack(np.meshgrid(*3 * [[0.0, 1.0]]), axis=-1).reshape(-1, 3)
    part = mesh(corners, np.array(faces))
    try:
        solid = Solid(mesh_of(part))
    except InvalidInput:
        assert trimesh.triangles.area(part.triangles).max() < 1e-12
        return
    points = np.random.default_rng(0).uniform(-0.6, 0.6, (50, 3))
    assert np.isfinite(solid.distance(points)).all()
    far = np.abs(points / (solid.upper - solid.lower + 1e-9)).max(1) > 0.51
    assert not solid.inside(points)[far].any()
    assert isinstance(solid.report, str)
