"""Polygons into triangles, concave ones included."""

import numpy as np
from numpy.typing import NDArray

LARGEST_CLIPPED = 500  # corners: clipping ears takes quadratic time

Array = NDArray[np.float64]


def split_polygons(
    vertices: Array, corners: NDArray[np.integer], sizes: NDArray[np.integer]
) -> NDArray[np.int64]:
    """Triangles as positions [m, 3] in `corners`, in the order of the polygons.

    Polygon k has the next `sizes[k]` of the flat `corners`, which index `vertices` [n, 3]. Those of fewer
    than three corners are left out. The outline of each polygon is kept; only where one of more than 500
    corners is concave, or where it crosses itself, do triangles lie over one another.
    """
    starts = np.cumsum(sizes) - sizes
    triangles = starts[sizes == 3][:, None] + np.arange(3)
    if (sizes <= 3).all():
        return triangles
    quads = starts[sizes == 4][:, None] + np.arange(4)
    a, b, c, d = (vertices[corners[quads[:, k]]] for k in range(4))
    # Across a concave corner the two halves of the quad would face opposite ways.
    flat = (np.cross(b - a, c - a) * np.cross(c - a, d - a)).sum(1) >= 0
    halves = np.where(flat[:, None], [0, 1, 2, 0, 2, 3], [0, 1, 3, 1, 2, 3])
    parts = [triangles, np.take_along_axis(quads, halves, 1).reshape(-1, 3)]
    for start, size in zip(starts[sizes > 4], sizes[sizes > 4], strict=True):
        parts.append(start + _split(vertices[corners[start : start + size]]))
    whole = np.concatenate(parts)
    return whole[np.argsort(whole.min(1), kind="stable")]


def _split(p: Array) -> NDArray[np.int64]:
    """Triangles [n - 2, 3] of the polygon with corners p [n, 3]: a fan if it is convex, else by its ears."""
    n = len(p)
    edges = p - p[0]
    normal = np.cross(edges, np.roll(edges, -1, axis=0)).sum(0)
    drop = int(np.abs(normal).argmax())  # the projection along this axis distorts least
    flat = np.delete(p - p[0], drop, axis=1) * (1.0, np.sign(normal[drop]) * (-1) ** drop or 1.0)
    turns = _turn(np.roll(flat, 1, axis=0), flat, np.roll(flat, -1, axis=0))
    fan = np.stack([np.zeros(n - 2, int), np.arange(1, n - 1), np.arange(2, n)], axis=1)
    if (turns >= 0).all() or n > LARGEST_CLIPPED:
        return fan
    left, triangles, k = list(range(n)), [], 0
    since = 0  # corners looked at since the last ear
    while len(left) > 3 and since < len(left):
        k %= len(left)
        a, b, c = left[k - 1], left[k], left[(k + 1) % len(left)]
        if _is_ear(flat, a, b, c, left):
            triangles.append((a, b, c))
            del left[k]
            since = 0
        else:
            k, since = k + 1, since + 1
    triangles += [(left[0], left[k], left[k + 1]) for k in range(1, len(left) - 1)]
    return np.array(triangles)


def _is_ear(p: Array, a: int, b: int, c: int, left: list[int]) -> bool:
    if _turn(p[a], p[b], p[c]) <= 0:
        return False
    q = p[[k for k in left if k not in (a, b, c)]]
    inside = (_turn(p[a], p[b], q) >= 0) & (_turn(p[b], p[c], q) >= 0) & (_turn(p[c], p[a], q) >= 0)
    return not inside.any()


def _turn(a: Array, b: Array, c: Array) -> Array:
    """Twice the area of triangles abc in the plane, positive where they turn left."""
    u, v = b - a, c - a
    return u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]
