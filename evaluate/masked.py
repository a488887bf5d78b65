"""Visibility as the bit masks see it: each direction is blocked exactly where its cell's centre is.

With the same directions, light under this visibility less light under the exact spheres is what masks cost,
with exact integrals on both sides.
"""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from coslobe.evaluate.brdf import Vectors, dot
from coslobe.evaluate.occlusion import Occluders, Segments, entry_distance
from coslobe.evaluate.sampling import tangent_frame
from coslobe.render.mask import turns
from coslobe.tables.quadtree import disk

if TYPE_CHECKING:
    from coslobe.render.gbuffer import GBuffer
    from coslobe.render.scene import Mask

WIDEST = 0.25
"""Squared cosine of the half-angle of the widest light with a mask on a plane; wider ones are exact."""

PROBES = {
    "centre": (0.5,),
    "aggressive": (0.0, 1.0),  # blocked where the cell is along its whole row
    "conservative": (0.0, 0.5, 1.0),  # where it is anywhere along its row
}
"""Where along the row of a cell its visibility is asked for, as a share of the cell."""


class MaskedOccluders(Occluders):
    """Occluders whose answer for a direction is that for the centre of its mask cell.

    Cells at the rim whose centre misses the light have no bit; their directions are answered exactly.
    """

    def __init__(self, exact: Occluders, gbuffer: "GBuffer", mask: "Mask") -> None:
        self._exact = exact
        self._rows = 2**mask.depth
        self._probes = PROBES[mask.mode]
        self._all = mask.mode == "aggressive"
        own = turns(gbuffer.pixel, gbuffer.width)
        self._turns = dict(zip(map(bytes, np.ascontiguousarray(gbuffer.position)), own, strict=True))

    def blocked(self, segments: Segments) -> NDArray:
        """As in `Occluders`."""
        answers = [self._exact.blocked(self._probed(segments, probe)) for probe in self._probes]
        return np.logical_and.reduce(answers) if self._all else np.logical_or.reduce(answers)

    def _probed(self, segments: Segments, probe: float) -> Segments:
        """The segments, each turned to a place in its cell."""
        offset = segments.center - segments.position
        distance2 = np.einsum("ij,ij->i", offset, offset)
        sine2 = np.minimum(segments.radius**2 / np.maximum(distance2, np.finfo(float).tiny), 1.0)
        planar = (sine2 > 0) & (1 - sine2 > WIDEST)
        h = np.sqrt(sine2 / np.where(planar, 1 - sine2, 1.0))
        axis = offset / np.sqrt(np.maximum(distance2, np.finfo(float).tiny))[:, None]
        turn = np.array([self._turns[bytes(point)] for point in np.ascontiguousarray(segments.position)])
        t, u = _turned(axis, turn)
        along, x, y = (dot(vectors, segments.directions) for vectors in (axis, t, u))
        ahead = planar[:, None] & (along > 0)
        scale = np.where(planar, h, 1.0)[:, None] * np.where(ahead, along, 1.0)
        column, row = (self._cell(part, scale, ahead) for part in (x, y))
        on_disk = ahead & disk(self._rows)[row, column]
        across, up = (2 * (column + probe) / self._rows - 1, 2 * (row + 0.5) / self._rows - 1)
        dx, dy, dz = (
            np.where(on_disk, new, old)
            for new, old in zip(
                _unit(h[:, None] * across, h[:, None] * up, t, u, axis), segments.directions, strict=True
            )
        )
        directions = (dx, dy, dz)
        reach = entry_distance(segments.position, directions, segments.center, segments.radius)
        return replace(segments, directions=directions, reach=reach)

    def _cell(self, part: NDArray, scale: NDArray, ahead: NDArray) -> NDArray:
        place = np.where(ahead, part / scale, 0.0)
        return np.clip(np.floor((place + 1) / 2 * self._rows), 0, self._rows - 1).astype(int)


def _turned(axis: NDArray, turn: NDArray) -> tuple[NDArray, NDArray]:
    """The axes of masks around unit vectors [n, 3]: `render.mask.frame_around` for many."""
    t, u = tangent_frame(axis)
    cosine, sine = np.cos(2 * np.pi * turn)[:, None], np.sin(2 * np.pi * turn)[:, None]
    return cosine * t + sine * u, cosine * u - sine * t


def _unit(across: NDArray, up: NDArray, t: NDArray, u: NDArray, axis: NDArray) -> Vectors:
    """Unit directions axis + across t + up u: x, y, z of [n, s]."""
    length = np.sqrt(1 + across**2 + up**2)
    x, y, z = ((axis[:, i, None] + across * t[:, i, None] + up * u[:, i, None]) / length for i in range(3))
    return x, y, z
