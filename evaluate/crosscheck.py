"""Coslobe's references against Mitsuba 3: an independent renderer for camera, units, BRDFs and light.

Mitsuba is optional (`pip install coslobe[mitsuba]`). Its own camera averages over random positions in each
pixel where coslobe takes the centre or `image.samples` positions: edges of whole images differ unless there
are many. `estimate_with_mitsuba` therefore gives it coslobe's own camera rays.
"""

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from coslobe.core.errors import CoslobeError
from coslobe.evaluate import mitsuba_lobes
from coslobe.evaluate.integration import Estimate
from coslobe.evaluate.mitsuba_scene import (
    describe,
    direct_integrator,
    for_mitsuba,
    path_integrator,
    write_ply,
)
from coslobe.render.camera import camera_rays

if TYPE_CHECKING:
    from coslobe.evaluate.reference import OccluderKind
    from coslobe.render.assets import Assets
    from coslobe.render.scene import Scene

__all__ = [
    "acceptance",
    "best_variant",
    "estimate_with_mitsuba",
    "image_shift",
    "mitsuba_scene",
    "render_with_mitsuba",
    "write_ply",
    "z_scores",
]

WAVE = 1 << 18
"""Rays that Mitsuba traces at once."""

ROUNDING = 1e-4
"""Standard error, in parts of the value, that is granted to Mitsuba's single precision."""

SIGNIFICANCE = 0.01
"""Probability with which a perfect image has any pixel that is not accepted."""


def render_with_mitsuba(
    scene: "Scene", assets: "Assets", samples: int, *, seed: int = 0, variant: str = "scalar_rgb"
) -> NDArray:
    """Direct light by Mitsuba's `direct` integrator, one light sample per camera sample: float64 [h, w, 3].

    The variant `llvm_ad_rgb` is ten times faster, but an unsuitable libLLVM ends the process: 15 does,
    19 works.

    Raises
    ------
    CoslobeError
        Mitsuba is not installed, or cannot express the scene.
    """
    mitsuba = load_mitsuba(variant)
    with tempfile.TemporaryDirectory(prefix="coslobe-mitsuba-") as folder:
        loaded = mitsuba.load_dict(mitsuba_scene(mitsuba, scene, assets, samples, Path(folder)))
        image = mitsuba.render(loaded, spp=samples, seed=seed)
        return np.array(image, dtype=np.float64).reshape(scene.image.height, scene.image.width, 3)


def mitsuba_scene(
    mitsuba: Any, scene: "Scene", assets: "Assets", samples: int, folder: Path
) -> dict[str, Any]:
    """The scene with the `direct` integrator, for `mitsuba.load_dict`; meshes and textures go into `folder`.

    Transforms are Mitsuba's own objects, made by the module `mitsuba`, whose variant must be set.
    """
    description = describe(scene, assets, folder, samples=samples, integrator=direct_integrator())
    return for_mitsuba(mitsuba, description)


def estimate_with_mitsuba(
    scene: "Scene",
    assets: "Assets",
    samples: int,
    *,
    seed: int = 0,
    variant: str = "scalar_rgb",
    occluders: "OccluderKind" = "mesh",
    bounces: int = 1,
) -> Estimate:
    """What coslobe's camera rays see in Mitsuba's `path` integrator, [rays, 3] in the order of `camera_rays`.

    With the variance of every mean. Rays that meet nothing see 0, and so do, as in coslobe, those that meet a
    light. Errors as in `render_with_mitsuba`.
    """
    mitsuba = load_mitsuba(variant)
    rays = camera_rays(scene)
    with tempfile.TemporaryDirectory(prefix="coslobe-mitsuba-") as folder:
        integrator = path_integrator(bounces)
        description = describe(
            scene, assets, Path(folder), samples=samples, integrator=integrator, occluders=occluders
        )
        loaded = mitsuba.load_dict(for_mitsuba(mitsuba, description))
    trace = _trace_one_by_one if variant.startswith("scalar") else _trace_together
    total, squares = np.zeros((2, len(rays.direction), 3))
    for values in trace(mitsuba, loaded, rays.origin, rays.direction, samples, seed):
        total += values.sum(axis=0)
        squares += (values**2).sum(axis=0)
    mean = total / samples
    return Estimate(mean, np.maximum(squares / samples - mean**2, 0) / max(samples - 1, 1))


def _trace_together(
    mitsuba: Any, scene: Any, origin: NDArray, direction: NDArray, samples: int, seed: int
) -> Any:
    """Values of rounds of samples, float64 [k, rays, 3]."""
    n = len(direction)
    count = max(min(WAVE // n, samples), 1)
    start = mitsuba.Point3f(*(float(x) for x in origin))
    towards = mitsuba.Vector3f(*np.tile(direction.T.astype(np.float32), (1, count)))
    integrator = scene.integrator()
    for first in range(0, samples, count):
        sampler = mitsuba.load_dict({"type": "independent"})
        sampler.seed(seed * 1_000_003 + first, n * count)
        ray = mitsuba.RayDifferential3f(mitsuba.Ray3f(start, towards))
        spectrum, *_ = integrator.sample(scene, sampler, ray)
        values = np.array(spectrum, np.float64).T.reshape(count, n, 3)
        yield values[: samples - first]


def _trace_one_by_one(
    mitsuba: Any, scene: Any, origin: NDArray, direction: NDArray, samples: int, seed: int
) -> Any:
    """As `_trace_together`, for variants without vectors."""
    sampler = mitsuba.load_dict({"type": "independent"})
    sampler.seed(seed, 1)
    integrator = scene.integrator()
    rays = [mitsuba.RayDifferential3f(mitsuba.Ray3f(list(origin), list(towards))) for towards in direction]
    for _ in range(samples):
        colours = [integrator.sample(scene, sampler, ray)[0] for ray in rays]
        yield np.array([list(colour) for colour in colours], np.float64)[None]


def z_scores(ours: Estimate, theirs: Estimate) -> NDArray:
    """Differences over their standard errors, [n, 3]; 0 where both are the same."""
    difference = ours.radiance - theirs.radiance
    rounding = ROUNDING * np.maximum(ours.radiance, theirs.radiance)
    error = np.sqrt(ours.variance + theirs.variance + rounding**2)
    with np.errstate(divide="ignore"):
        return np.divide(difference, error, out=np.zeros_like(difference), where=difference != 0)


def acceptance(z: NDArray) -> float:
    """Share of pixels [n, 3] whose difference may be chance, with Šidák's correction for testing many."""
    from scipy.special import ndtri

    alone = -np.expm1(np.log1p(-SIGNIFICANCE) / z.size)
    return float(np.mean((np.abs(z) <= -ndtri(alone / 2)).all(axis=1)))


def best_variant() -> str:
    """`llvm_ad_rgb` where a child process survives its first use, else `scalar_rgb`."""
    import subprocess
    import sys

    code = (
        "import mitsuba; mitsuba.set_variant('llvm_ad_rgb'); assert list(mitsuba.Float([1, 2]) + 1) == [2, 3]"
    )
    tried = subprocess.run([sys.executable, "-c", code], capture_output=True, check=False, timeout=120)
    return "llvm_ad_rgb" if tried.returncode == 0 else "scalar_rgb"


def load_mitsuba(variant: str) -> Any:
    """The module `mitsuba` in one variant, with coslobe's BSDF.

    Raises
    ------
    CoslobeError
        Mitsuba is not installed, or the variant does not load.
    """
    try:
        import mitsuba

        mitsuba.set_variant(variant)
    except ImportError as error:
        raise CoslobeError(
            f"Mitsuba ({variant}) cannot be loaded ({error})", "pip install 'coslobe[mitsuba]'"
        ) from error
    mitsuba_lobes.register(mitsuba)
    return mitsuba


def image_shift(image: NDArray, reference: NDArray) -> tuple[float, float]:
    """By how many pixels (right, down) `image` [h, w] is displaced against `reference`, for small shifts.

    Least squares over all inner pixels of the first-order expansion (Lucas and Kanade 1981).
    """
    mean = (image + reference) / 2
    down, right = np.gradient(mean, axis=0), np.gradient(mean, axis=1)
    inner = (slice(1, -1), slice(1, -1))
    gradient = np.stack([right[inner].ravel(), down[inner].ravel()], axis=-1)
    difference = (reference - image)[inner].ravel()
    right_by, down_by = np.linalg.lstsq(gradient, difference, rcond=None)[0].tolist()
    return right_by, down_by
