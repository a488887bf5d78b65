"""PLY files, ASCII and binary of both byte orders.

Read here because the reader of trimesh refuses binary files in which polygons differ in size, and because a
file that announces more than it holds must not be believed with memory.
"""

import warnings
from array import array
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from coslobe.spheresets.polygons import split_polygons

# Names of the format's first description and those of its later users.
TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
ORDERS = {"ascii": "<", "binary_little_endian": "<", "binary_big_endian": ">"}
LONGEST_LINE = 4096  # of a header
INDICES = ("vertex_indices", "vertex_index")
TEXTURE = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"))


@dataclass(frozen=True)
class Property:
    """One number per item, or with `length` (the type of its length) a list of numbers."""

    name: str
    type: np.dtype
    length: np.dtype | None


@dataclass(frozen=True)
class Element:
    """A table of `count` items."""

    name: str
    count: int
    properties: list[Property]


def read_ply(
    path: Path,
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """Vertices [n, 3], triangles [m, 3], normals [n, 3] (else 0) and texture coordinates [n, 2] (else NaN).

    Raises
    ------
    ValueError
        With the reason.
    """
    with open(path, "rb") as file:
        ascii_, elements = _header(file)
        if ascii_:
            # Text is then the same as binary: a table of numbers of 8 bytes.
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # text that is no number ends the table, which is noticed
                data = np.fromfile(file, np.float64, sep=" ").view(np.uint8)
        else:
            start, end = file.tell(), file.seek(0, 2)
            data = np.memmap(path, np.uint8, "r", start) if end > start else np.zeros(0, np.uint8)
    tables = {}
    for element in elements:
        tables[element.name], used = _table(data, element)
        data = data[used:]
    vertex = tables.get("vertex", {})
    if not {"x", "y", "z"} <= vertex.keys():
        raise ValueError("no vertices with x, y and z")
    vertices = np.stack([vertex[k] for k in "xyz"], axis=1).astype(np.float64)
    normals = _columns(vertex, ("nx", "ny", "nz"))
    normals = np.zeros_like(vertices) if normals is None else normals
    found = (_columns(vertex, names) for names in TEXTURE)
    uv = next((pair for pair in found if pair is not None), np.broadcast_to(np.nan, (len(vertices), 2)))
    polygons = next((tables["face"][name] for name in INDICES if name in tables.get("face", {})), None)
    if polygons is None:
        return vertices, np.zeros((0, 3), np.int64), normals, uv
    corners, sizes = polygons
    wrong = (corners < 0) | (corners >= len(vertices))
    if wrong.any():
        raise ValueError(
            f"a face refers to vertex {int(corners[wrong][0])}, but the file has {len(vertices)}"
        )
    if (sizes == 3).all():
        return vertices, corners.reshape(-1, 3), normals, uv
    corners = corners.astype(np.int64)
    return vertices, corners[split_polygons(vertices, corners, sizes)], normals, uv


def _columns(table: dict, names: tuple[str, ...]) -> NDArray[np.float64] | None:
    """Columns side by side; None where one is missing."""
    if not all(name in table for name in names):
        return None
    return np.stack([table[name] for name in names], axis=1).astype(np.float64)


def _header(file: BinaryIO) -> tuple[bool, list[Element]]:
    if file.readline(LONGEST_LINE).strip() != b"ply":
        raise ValueError("does not begin with 'ply'")
    encoding, elements = "", []
    while True:
        line = file.readline(LONGEST_LINE)
        if not line:
            raise ValueError("the header does not end")
        words = line.decode("ascii", "replace").split()
        match words:
            case ["format", encoding, _]:
                if encoding not in ORDERS:
                    raise ValueError(f"unknown format {encoding!r}")
            case ["element", name, count] if count.isdecimal():
                elements.append(Element(name, int(count), []))
            case ["property", "list", length, type_, name] if elements:
                types = _type(type_, encoding), _type(length, encoding)
                elements[-1].properties.append(Property(name, *types))
            case ["property", type_, name] if elements:
                elements[-1].properties.append(Property(name, _type(type_, encoding), None))
            case ["end_header"]:
                break
            case ["comment" | "obj_info", *_] | []:
                pass
            case _:
                raise ValueError(f"header line {' '.join(words)[:60]!r} is not understood")
    if not encoding:
        raise ValueError("the header names no format")
    return encoding == "ascii", elements


def _type(name: str, encoding: str) -> np.dtype:
    if name not in TYPES:
        raise ValueError(f"unknown type {name!r}")
    return np.dtype(ORDERS.get(encoding, "<") + ("f8" if encoding == "ascii" else TYPES[name]))


def _table(data: NDArray[np.uint8], element: Element) -> tuple[dict, int]:
    """Columns by name, [count] numbers or for lists (values, lengths [count]); how many bytes they took."""
    least = sum((p.length or p.type).itemsize for p in element.properties)
    if element.count * least > len(data):
        raise ValueError(f"holds less than the {element.count:,} items of '{element.name}' that it announces")
    if not element.count:
        none = np.zeros(0, np.int64)
        return {p.name: none if p.length is None else (none, none) for p in element.properties}, 0
    # Nearly always all lists of a column are as long as the first, which makes the table one array.
    lengths = [rows[0] if rows else 0 for rows in _walk(data, replace(element, count=1))[1]]
    fields = []
    for k, (p, length) in enumerate(zip(element.properties, lengths, strict=True)):
        fields += [(f"values {k}", p.type)] if p.length is None else [
            (f"length {k}", p.length), (f"values {k}", p.type, (length,))
        ]  # fmt: skip
    record = np.dtype(fields)
    used = element.count * record.itemsize
    lists = [k for k, p in enumerate(element.properties) if p.length is not None]
    table = data[:used].view(record) if used <= len(data) else None
    if table is None or any((table[f"length {k}"] != lengths[k]).any() for k in lists):
        return _ragged(data, element)
    columns: dict[str, Any] = {p.name: table[f"values {k}"] for k, p in enumerate(element.properties)}
    for k in lists:
        name = element.properties[k].name
        columns[name] = columns[name].reshape(-1), np.full(element.count, lengths[k])
    return columns, used


def _ragged(data: NDArray[np.uint8], element: Element) -> tuple[dict, int]:
    starts, lengths, used = _walk(data, element)
    columns = {}
    for p, start, length in zip(element.properties, starts, lengths, strict=True):
        sizes = np.array(length) if p.length is not None else np.ones(element.count, np.int64)
        before, step = np.cumsum(sizes) - sizes, p.type.itemsize
        at = np.repeat(np.array(start) - before * step, sizes) + np.arange(sizes.sum()) * step
        values = data[at[:, None] + np.arange(step)].view(p.type).reshape(-1)
        columns[p.name] = values if p.length is None else (values, sizes)
    return columns, used


def _walk(data: NDArray[np.uint8], element: Element) -> tuple[list[array], list[array], int]:
    """Where the values of each property start, item by item; how long lists are; where the table ends."""
    starts = [array("q") for _ in element.properties]
    lengths = [array("q") for _ in element.properties]
    at = 0
    for _ in range(element.count):
        for k, p in enumerate(element.properties):
            size = 1
            if p.length is not None:
                found = data[at : at + p.length.itemsize]
                if len(found) < p.length.itemsize:
                    raise ValueError(f"ends within '{element.name}'")
                size = int(found.view(p.length)[0])
                if not 0 <= size <= len(data):
                    raise ValueError(f"a list of '{element.name}' has length {size}")
                at += p.length.itemsize
                lengths[k].append(size)
            starts[k].append(at)
            at += size * p.type.itemsize
        if at > len(data):
            raise ValueError(f"ends within '{element.name}'")
    return starts, lengths, at
