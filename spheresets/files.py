"""Sphere files: `NAME.spheres.json`."""

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coslobe.core.errors import InvalidInput
from coslobe.core.files import read_bytes, write_text
from coslobe.spheresets.mesh import Mesh
from coslobe.spheresets.model import Hierarchy, MeshInfo, SphereSet, SphereTree

FORMAT = "coslobe-spheres/1"
SUFFIX = ".spheres.json"
HINT = "write the file again with `coslobe spheres MESH`"


def write_spheres(path: str | Path, tree: SphereTree) -> None:
    """Write a sphere file; numbers survive the round trip to the last bit."""
    document = {
        "format": FORMAT,
        "mesh": vars(tree.mesh),
        "method": tree.method,
        "quality": tree.quality,
        "mode": tree.mode,
        "seed": tree.seed,
        "seconds": tree.seconds,
        "levels": [
            {
                "centers": level.centers.tolist(),
                "radii": level.radii.tolist(),
                "parents": parents.tolist(),
                "outside": level.outside.tolist(),
            }
            for level, parents in zip(tree.levels, tree.parents, strict=True)
        ],
        "hierarchy": {name: values.tolist() for name, values in vars(tree.hierarchy).items()},
        "metrics": tree.metrics,
    }
    # One line per key: thousands of numbers stay out of the way of a reader.
    lines = (f" {json.dumps(key)}: {json.dumps(value, allow_nan=False)}" for key, value in document.items())
    write_text(Path(path), "{\n" + ",\n".join(lines) + "\n}\n")


def read_spheres(path: str | Path) -> SphereTree:
    """Read and check a sphere file.

    Raises
    ------
    InvalidInput
        The file cannot be read, or something in it is missing or wrong; the message names the key.
    """
    return _Reader(Path(path)).tree()


def mismatch(tree: SphereTree, mesh: Mesh) -> str | None:
    """A warning where `tree` was fitted to other file contents than `mesh` has, else None."""
    if tree.mesh.sha256 == mesh.sha256:
        return None
    return (
        f"the spheres were fitted to another version of {mesh.file} "
        f"({tree.mesh.vertices} vertices, {tree.mesh.faces} triangles; "
        f"now {len(mesh.vertices)} and {len(mesh.faces)}); fit them again with `coslobe spheres {mesh.file}`"
    )


class _Reader:
    """One sphere file while it is being read; errors carry its path and the key."""

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            document = json.loads(read_bytes(path, "sphere file"))
        except ValueError as error:
            raise InvalidInput(f"{path}: is not JSON ({error})", HINT) from error
        if not isinstance(document, dict) or document.get("format") != FORMAT:
            found = document.get("format") if isinstance(document, dict) else type(document).__name__
            self.fail("format", f'must be "{FORMAT}" (got {found!r})')
        self.document: dict[str, Any] = document

    def fail(self, key: str, complaint: str) -> None:
        raise InvalidInput(f"{self.path}: {key}: {complaint}", HINT)

    def tree(self) -> SphereTree:
        levels, parents = [], []
        entries = self.value(self.document, "levels", list)
        if not entries:
            self.fail("levels", "must hold at least one level")
        for index, entry in enumerate(entries):
            level, level_parents = self.level(entry, f"levels[{index}]")
            above = len(levels[-1].radii) if levels else 0
            wrong = (level_parents != -1) if not levels else (level_parents < 0) | (level_parents >= above)
            if wrong.any():
                at = int(np.flatnonzero(wrong)[0])
                expected = f"from 0 to {above - 1}" if levels else "-1 in the first level"
                self.fail(f"levels[{index}].parents[{at}]", f"must be {expected} (got {level_parents[at]})")
            levels.append(level)
            parents.append(level_parents)
        mesh = self.value(self.document, "mesh", dict)
        return SphereTree(
            levels=tuple(levels),
            parents=tuple(parents),
            hierarchy=self.hierarchy(levels[-1].count),
            mesh=MeshInfo(
                self.value(mesh, "file", str, "mesh."),
                self.value(mesh, "sha256", str, "mesh."),
                self.value(mesh, "vertices", int, "mesh."),
                self.value(mesh, "faces", int, "mesh."),
            ),
            method=self.value(self.document, "method", str),
            quality=self.value(self.document, "quality", str),
            mode=self.value(self.document, "mode", str),
            seed=self.value(self.document, "seed", int),
            seconds=float(self.value(self.document, "seconds", (int, float))),
            metrics=self.value(self.document, "metrics", dict),
        )

    def level(self, entry: Any, place: str) -> tuple[SphereSet, NDArray[np.int32]]:
        if not isinstance(entry, dict):
            self.fail(place, f"must be an object (got {type(entry).__name__})")
        radii = self.numbers(entry, "radii", place, None)
        n = len(radii)
        if n == 0:
            self.fail(f"{place}.radii", "must hold at least one sphere")
        centers = self.numbers(entry, "centers", place, n, columns=3)
        outside = self.numbers(entry, "outside", place, n)
        parents = self.indices(entry, "parents", place, n)
        for name, values, least in (("radii", radii, 0.0), ("outside", outside, -np.inf)):
            wrong = np.flatnonzero(values <= least if name == "radii" else values < 0)
            if wrong.size:
                bound = "> 0" if name == "radii" else ">= 0"
                self.fail(f"{place}.{name}[{wrong[0]}]", f"must be {bound} (got {values[wrong[0]]})")
        return SphereSet(centers, radii, outside), parents

    def hierarchy(self, leaves: int) -> Hierarchy:
        entry = self.value(self.document, "hierarchy", dict)
        radii = self.numbers(entry, "radii", "hierarchy", None)
        m = len(radii)
        first, count = (self.indices(entry, name, "hierarchy", m) for name in ("first_child", "child_count"))
        wrong = np.flatnonzero((first < 1) | (count < 1) | (first.astype(np.int64) + count > m + leaves))
        if wrong.size:
            self.fail(f"hierarchy.first_child[{wrong[0]}]", f"children must lie within 1 to {m + leaves - 1}")
        return Hierarchy(self.numbers(entry, "centers", "hierarchy", m, columns=3), radii, first, count)

    def value(self, entry: dict[str, Any], key: str, kind: Any, prefix: str = "") -> Any:
        if key not in entry:
            self.fail(prefix + key, "is missing")
        value = entry[key]
        if not isinstance(value, kind) or isinstance(value, bool):
            self.fail(prefix + key, f"has the wrong type ({type(value).__name__})")
        return value

    def numbers(
        self, entry: dict[str, Any], key: str, place: str, count: int | None, columns: int = 0
    ) -> NDArray[np.float64]:
        values = self.value(entry, key, list, f"{place}.")
        try:
            array = np.array(values, dtype=np.float64)
        except (TypeError, ValueError):
            array = np.full(1, np.nan)
        expected = (len(values) if count is None else count, *([columns] if columns else []))
        if array.size == 0:
            array = array.reshape(0, *expected[1:])
        if array.shape != expected or not np.isfinite(array).all():
            shape = " x ".join(map(str, expected))
            self.fail(f"{place}.{key}", f"must be {shape} finite numbers")
        return array

    def indices(self, entry: dict[str, Any], key: str, place: str, count: int) -> NDArray[np.int32]:
        values = self.numbers(entry, key, place, count)
        if (values != np.rint(values)).any() or (np.abs(values) >= 2**31).any():
            self.fail(f"{place}.{key}", "must be whole numbers")
        return values.astype(np.int32)
