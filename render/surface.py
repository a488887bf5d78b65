"""What materials need to know of the shaded points: values of their textures, and the tangent frame."""

from dataclasses import replace
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from coslobe.core.errors import InvalidInput
from coslobe.render.fields import Source
from coslobe.render.textures import look_up

if TYPE_CHECKING:
    from coslobe.render.assets import Assets
    from coslobe.render.gbuffer import GBuffer
    from coslobe.render.scene import Scene
    from coslobe.spheresets.mesh import Mesh


class OnObjects(Protocol):
    """Points of which is known on which object's triangles they lie."""

    def __len__(self) -> int: ...

    def on(self, index: int) -> tuple[NDArray, NDArray, NDArray]:
        """Which points lie on an object [m], their triangles [m] and the weights of the corners [m, 3]."""
        ...

    @property
    def shading_normal(self) -> NDArray:
        """Unit vectors, float64 [n, 3]."""
        ...


def with_surface(gbuffer: "GBuffer", scene: "Scene", assets: "Assets") -> "GBuffer":
    """`gbuffer` with the texels and tangents that the scene's materials ask for; errors as in `surface`."""
    texels, tangent = surface(gbuffer, scene, assets)
    return replace(gbuffer, texels=texels, tangent=tangent)


def surface(
    points: OnObjects, scene: "Scene", assets: "Assets"
) -> tuple[dict[Source, NDArray], NDArray | None]:
    """Texels by picture and tangents of `points` as in `GBuffer`, as far as materials ask for them.

    Raises
    ------
    InvalidInput
        A picture cannot be read, or a mesh lacks the texture coordinates that its material needs.
    """
    texels: dict[Source, NDArray] = {}
    n = len(points)
    along = None
    for index, (name, obj) in enumerate(scene.objects.items()):
        material = scene.materials[obj.material]
        if not (obj.visible and (material.pictures or material.anisotropic)):
            continue
        mesh = assets.mesh(obj)
        here, triangle, weights = points.on(index)
        corners = mesh.faces[triangle]
        if material.pictures:
            uv = _between(_texture_coordinates(mesh, f"objects.{name}", obj.material), corners, weights)
            for source in material.pictures:
                found = look_up(assets.texels(source), uv)
                texels.setdefault(source, np.zeros((n, *found.shape[1:])))[here] = found
        if material.anisotropic:
            along = np.zeros((n, 3)) if along is None else along
            if material.tangent is not None:
                local = np.asarray(material.tangent, np.float64)
            else:
                _texture_coordinates(mesh, f"objects.{name}", obj.material)
                local = _aligned(assets.tangents(obj)[corners], weights)
            along[here] = local @ obj.transform.matrix()[:3, :3].T
    return texels, None if along is None else perpendicular(along, points.shading_normal)


def _texture_coordinates(mesh: "Mesh", place: str, material: str) -> NDArray:
    if mesh.uv is None or not np.isfinite(mesh.uv).all():
        raise InvalidInput(
            f"{place}: {mesh.file} has no texture coordinates, which material {material} needs",
            "export the mesh with them; a material without textures may give its tangent instead",
        )
    return mesh.uv


def _between(values: NDArray, corners: NDArray, weights: NDArray) -> NDArray:
    return np.einsum("nk,nkc->nc", weights, values[corners])


def vertex_tangents(mesh: "Mesh") -> NDArray[np.float64]:
    """The direction of growing u at each vertex of a mesh with texture coordinates, [n, 3]; 0 where none is.

    A unit vector, or its opposite: only the line means something. Lines of the triangles around a vertex are
    averaged as dyads, weighted by area, so that mirrored texture coordinates do not cancel.
    """
    assert mesh.uv is not None
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    ua, ub, uc = (mesh.uv[mesh.faces[:, k]] for k in range(3))
    e1, e2, d1, d2 = b - a, c - a, ub - ua, uc - ua
    along = d2[:, 1:] * e1 - d1[:, 1:] * e2  # dP/du times the determinant, whose sign does not matter
    length = np.linalg.norm(along, axis=1, keepdims=True)
    along = np.divide(along, length, out=np.zeros_like(along), where=length > 0)
    area = np.linalg.norm(np.cross(e1, e2), axis=1)
    dyads = np.zeros((len(mesh.vertices), 3, 3))
    for k in range(3):
        np.add.at(dyads, mesh.faces[:, k], area[:, None, None] * along[:, :, None] * along[:, None, :])
    size = np.trace(dyads, axis1=1, axis2=2)
    principal = np.linalg.eigh(dyads)[1][..., -1]
    return np.where(size[:, None] > 0, principal, 0.0)


def _aligned(tangents: NDArray, weights: NDArray) -> NDArray:
    """Between the lines at the corners [n, 3, 3]: their opposite ends must not cancel."""
    heaviest = np.take_along_axis(tangents, weights.argmax(axis=1)[:, None, None], axis=1)
    sign = np.where(np.einsum("nkc,njc->nk", tangents, heaviest) < 0, -1.0, 1.0)
    return np.einsum("nk,nkc->nc", weights * sign, tangents)


def perpendicular(along: NDArray, normal: NDArray) -> NDArray:
    """Unit vectors perpendicular to unit normals [n, 3], as near as can be to `along`; any where it is 0."""
    x = along - np.einsum("ij,ij->i", along, normal)[:, None] * normal
    length = np.linalg.norm(x, axis=1, keepdims=True)
    lost = length <= 1e-6 * np.linalg.norm(along, axis=1, keepdims=True)
    other = np.cross(normal, np.eye(3)[np.abs(normal).argmin(axis=1)])
    other /= np.linalg.norm(other, axis=1, keepdims=True)
    return np.where(lost, other, x / np.where(lost, 1.0, length))
