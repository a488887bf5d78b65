"""One frame held against its references: all numbers over the picture, its objects and its zones."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coslobe.core import cache
from coslobe.core.progress import SILENT, Progress
from coslobe.evaluate.analysis import Analysis
from coslobe.evaluate.flip import exposures, flip_maps
from coslobe.evaluate.metrics import Before, Maps, error_maps, measure, noise_floor, perfect
from coslobe.evaluate.reference import OccluderKind, Reference
from coslobe.evaluate.split import Split, split_error, split_numbers
from coslobe.evaluate.zones import zones
from coslobe.render.images import read_exr, stored_attributes, write_exr

KINDS: tuple[OccluderKind, ...] = ("mesh", "spheres")

NOISE_SEED = 2

ByKind = Mapping[OccluderKind, NDArray]


@dataclass(frozen=True)
class Frame:
    """A rendered frame and what it is held against.

    Attributes
    ----------
    index : int
    image : float64 [h, w, 3]
    references : dict of Reference
        By what blocks light.
    analysis : Analysis
    objects : dict
        Names of the objects by their index.
    """

    index: int
    image: NDArray
    references: Mapping[OccluderKind, Reference]
    analysis: Analysis
    objects: Mapping[int, str]

    @property
    def hit(self) -> NDArray:
        """Pixels that show a surface, bool [h, w]."""
        return self.references["mesh"].hit

    def mean(self, kind: OccluderKind) -> float:
        """The reference's mean over all pixels that show a surface; 0 without any."""
        return float(self.references[kind].radiance[self.hit].mean()) if self.hit.any() else 0.0

    def signed_error(self, kind: OccluderKind) -> NDArray:
        """(I - R) / mean(R), averaged over the channels: float64 [h, w], 0 where no surface is seen."""
        return self.relative(self.image - self.references[kind].radiance, kind)

    def relative(self, difference: NDArray, kind: OccluderKind = "mesh") -> NDArray:
        """A difference [h, w, 3] over the reference's mean, averaged over the channels, 0 off surfaces."""
        return np.where(self.hit, difference.mean(axis=-1) / (self.mean(kind) or 1.0), 0.0)

    def split(self) -> Split:
        """The three parts of the error against the true meshes."""
        return split_error(self.image, self.references["mesh"], self.references["spheres"], self.analysis)


def compare_frames(
    frames: Sequence[Frame], folder: Path, progress: Progress = SILENT
) -> list[dict[str, Any]]:
    """Per frame, the metrics over the picture (flat), its objects and its zones; see docs/evaluation.md.

    FLIP's error maps are kept in `folder`/flip.0000.exr.

    Raises
    ------
    CoslobeError
        A picture holds values that are not finite.
    """
    noisy: list[ByKind] = [
        {kind: perfect(frame.references[kind], NOISE_SEED + frame.index) for kind in KINDS}
        for frame in frames
    ]
    chosen = exposures([frame.references["mesh"].radiance[frame.hit] for frame in frames])
    records = []
    earlier: Frame | None = None
    with progress.task("comparing", len(frames)) as advance:
        for frame, drawn in zip(frames, noisy, strict=True):
            flips = _flip(frame, drawn, chosen, folder / f"flip.{frame.index:04d}.exr")
            follows = earlier is not None and frame.index == earlier.index + 1
            records.append(_record(frame, drawn, flips, earlier if follows else None))
            earlier = frame
            advance()
    return records


def _record(
    frame: Frame, drawn: ByKind, flips: Mapping[str, NDArray], before: Frame | None
) -> dict[str, Any]:
    what = f"frame {frame.index}"
    compared: dict[OccluderKind, _Compared] = {}
    for kind, reference in frame.references.items():
        earlier = None if before is None else Before(before.image, before.references[kind])
        name = f"{what} ({kind})"
        found = error_maps(frame.image, reference, flips.get(kind), earlier, name)
        noise = error_maps(drawn[kind], reference, flips.get(f"{kind}_noise"), None, name)
        compared[kind] = _Compared(found, noise, earlier)
    split = frame.split()
    index = frame.references["mesh"].object
    by_object = {
        name: region & frame.hit
        for number, name in frame.objects.items()
        if (region := index == number).any()
    }
    by_zone = {
        name: region for name, region in zones(frame.analysis.share, frame.hit).items() if region.any()
    }
    whole: dict[OccluderKind, float] = {kind: frame.mean(kind) for kind in KINDS}
    return {
        **_part(compared, split, frame.hit, what, {}),
        "objects": {
            name: _part(compared, split, region, f"{what}, object {name}", {})
            for name, region in by_object.items()
        },
        "zones": {
            name: _part(compared, split, region, f"{what}, {name}", whole) for name, region in by_zone.items()
        },
    }


@dataclass(frozen=True)
class _Compared:
    """Maps of the picture and of a perfect one, against one reference."""

    found: Maps
    noise: Maps
    before: Before | None


def _part(
    compared: Mapping[OccluderKind, _Compared],
    split: Split,
    region: NDArray,
    what: str,
    scales: Mapping[OccluderKind, float],
) -> dict[str, Any]:
    """All numbers of one region; `scales` takes the place of the region's own means."""
    part: dict[str, Any] = {"pixels": int(region.sum()), "noise_floor": {}}
    for kind, maps in compared.items():
        scale = scales.get(kind)
        numbers = measure(maps.found, region, f"{what} ({kind})", scale=scale)
        floor = noise_floor(maps.noise, region, f"{what} ({kind})", maps.before, scale=scale)
        part |= {f"{name}_{kind}": value for name, value in numbers.items()}
        part[f"noise_{kind}"] = floor["relative_rmse"]
        part["noise_floor"][kind] = floor
    own = compared["mesh"].found.reference[region]
    scale = scales.get("mesh", float(own.mean()) if own.size else 0.0)
    part["split"] = split_numbers(split, region, scale)
    return part


def _flip(
    frame: Frame, drawn: ByKind, chosen: tuple[float, float, int] | None, path: Path
) -> dict[str, NDArray]:
    """FLIP's maps of the picture and of a perfect one by reference, from the file where it fits."""
    if chosen is None:
        return {}
    pairs = {kind: (frame.references[kind].radiance, frame.image) for kind in KINDS}
    pairs |= {f"{kind}_noise": (frame.references[kind].radiance, drawn[kind]) for kind in KINDS}
    contents = hashlib.sha256(
        b"".join(np.ascontiguousarray(image).tobytes() for pair in pairs.values() for image in pair)
    ).hexdigest()
    settings = cache.digest("flip", contents, chosen)
    if stored_attributes(path).get("config_sha256") == settings:
        return read_exr(path)[0]
    maps = dict(zip(pairs, flip_maps(list(pairs.values()), chosen), strict=True))
    write_exr(path, maps, {"config_sha256": settings, "frame": frame.index})
    return maps
