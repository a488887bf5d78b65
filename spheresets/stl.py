"""STL files, binary and ASCII."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from coslobe.spheresets.orientation import coincident

RECORD = np.dtype([("normal", "<f4", (3,)), ("corners", "<f4", (3, 3)), ("attributes", "<u2")])
HEAD = 84  # bytes before the records; the last four count them


def read_stl(
    path: Path,
) -> tuple[NDArray[np.float64], NDArray[np.int32], NDArray[np.float64], NDArray[np.float64]]:
    """Vertices [n, 3], triangles [m, 3], normals [n, 3] (zero) and texture coordinates [n, 2] (NaN).

    The format repeats the corners of its triangles; here those at the same place are one vertex.

    Raises
    ------
    ValueError
        With the reason.
    """
    with open(path, "rb") as file:
        head = file.read(1024)
    if len(head) < HEAD or b"facet" in head.lower():  # binary files, too, may begin with "solid"
        import trimesh

        corners = np.asarray(trimesh.load_mesh(path, process=False).triangles, np.float64)
    else:
        count = int.from_bytes(head[HEAD - 4 : HEAD], "little")
        held = (path.stat().st_size - HEAD) / RECORD.itemsize
        if count != held:
            raise ValueError(f"announces {count:,} triangles, holds {held:,.1f}")
        corners = np.memmap(path, RECORD, "r", HEAD)["corners"] if count else np.zeros((0, 3, 3))
    points = corners.reshape(-1, 3).astype(np.float64)
    place, places = coincident(points)
    vertices = np.empty((places, 3))
    vertices[place] = points
    return vertices, place.reshape(-1, 3), np.zeros_like(vertices), np.broadcast_to(np.nan, (places, 2))
