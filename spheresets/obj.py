"""Wavefront OBJ files.

Read here because the reader of trimesh counts negative indices from the end of the file instead of back from
their line, which moves faces to wrong vertices without a word, cuts concave polygons into fans, and needs
about thirty times the memory.
"""

from array import array
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coslobe.spheresets.polygons import split_polygons


def read_obj(
    path: Path,
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """Vertices [n, 3], triangles [m, 3], normals [n, 3] (else 0) and texture coordinates [n, 2] (else NaN).

    A vertex that the file uses with several normals or texture coordinates becomes several. Groups, materials
    and lines are left out.

    Raises
    ------
    ValueError
        With the reason and the line.
    """
    points, uv, normals = array("d"), array("d"), array("d")
    corners, corner_uv, corner_normals, sizes = array("q"), array("q"), array("q"), array("q")
    with open(path, "rb") as file:
        number, line = 0, b""
        for number, text in enumerate(file, 1):
            line += text
            if line.endswith((b"\\\n", b"\\\r\n")):  # goes on in the next line
                line = line.rstrip(b"\\\r\n") + b" "
                continue
            words, line = line.partition(b"#")[0].split(), b""
            try:
                if not words:
                    continue
                if words[0] == b"v":
                    points.extend(_three(words))
                elif words[0] == b"vn":
                    normals.extend(_three(words))
                elif words[0] == b"vt":
                    uv.extend([_number(float, word) for word in [*words[1:3], b"0"][:2]])
                elif words[0] == b"f":
                    for word in words[1:]:
                        vertex, *others = word.split(b"/")
                        corners.append(_absolute(vertex, len(points) // 3))
                        placed = len(others) > 0 and others[0]
                        corner_uv.append(_absolute(others[0], len(uv) // 2) if placed else -1)
                        named = len(others) == 2 and others[1]
                        corner_normals.append(_absolute(others[1], len(normals) // 3) if named else -1)
                    sizes.append(len(words) - 1)
            except ValueError as error:
                raise ValueError(f"line {number}: {error}") from error
    vertices = np.array(points).reshape(-1, 3)
    directions = np.concatenate([np.array(normals).reshape(-1, 3), np.zeros((1, 3))])
    places = np.concatenate([np.array(uv).reshape(-1, 2), np.full((1, 2), np.nan)])
    vertex, place, normal = (np.array(c, np.int64) for c in (corners, corner_uv, corner_normals))
    for what, index, count in (
        ("vertex", vertex, len(vertices)),
        ("texture coordinates", place, len(places) - 1),
        ("normal", normal, len(directions) - 1),
    ):
        if len(index) and index.max() >= count:
            raise ValueError(f"a face refers to {what} {index.max() + 1}, but the file has {count}")
    faces = split_polygons(vertices, vertex, np.array(sizes, np.int64))
    if not len(normals) and not len(uv):
        return vertices, vertex[faces], np.zeros_like(vertices), np.broadcast_to(np.nan, (len(vertices), 2))
    used, index = _distinct(vertex, place, normal)
    return vertices[vertex[used]], index[faces], directions[normal[used]], places[place[used]]


def _distinct(*columns: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The first of each kind of rows of integers, and which of them each row is."""
    index = np.zeros(len(columns[0]), np.int64)
    for column in columns:  # two columns at a time fit an integer
        _, first, index = np.unique(
            index * (column.max(initial=0) + 2) + column + 1, return_index=True, return_inverse=True
        )
    return first, index


def _three(words: list[bytes]) -> list[float]:
    if len(words) < 4:
        raise ValueError(f"{len(words) - 1} coordinates where three are needed")
    return [_number(float, word) for word in words[1:4]]


def _absolute(word: bytes, count: int) -> int:
    """An index from 0 of one that counts from 1, or back from the last of `count` that were read so far."""
    index = _number(int, word)
    if index == 0 or index < -count:
        raise ValueError(f"index {index} does not exist ({count} so far)")
    return index - 1 if index > 0 else count + index


def _number(kind: Any, word: bytes) -> Any:
    try:
        return kind(word)
    except ValueError:
        raise ValueError(f"{word.decode('ascii', 'replace')[:40]!r} is no number") from None
