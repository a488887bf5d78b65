"""How long references of the shipped scenes take, how honest their noise is, and how near Mitsuba they are.

python benchmarks/references.py [noise|mitsuba] [SCENE ...] prints one row of a Markdown table per scene.
"""

import sys
import time

import numpy as np

from coslobe import configs
from coslobe.core.device import open_device
from coslobe.core.errors import CoslobeError
from coslobe.evaluate.adaptive import Goal, integrate_adaptively
from coslobe.evaluate.crosscheck import acceptance, best_variant, estimate_with_mitsuba, z_scores
from coslobe.evaluate.direct import direct_sources
from coslobe.evaluate.integration import Estimate, integrate, uniform
from coslobe.evaluate.occlusion import mesh_occluders
from coslobe.evaluate.paths import BouncedLight
from coslobe.evaluate.sampling import strata
from coslobe.render.assets import Assets
from coslobe.render.camera import camera_rays
from coslobe.render.gbuffer import trace_gbuffer
from coslobe.render.scene import Scene, load_scene

SCENES = (
    "fig17",
    "bunny",
    "fig13",
    "fig14",
    "fig15",
    "fig16",
    "fig18",
    "showcase_dance",
    "showcase_lights",
    "showcase_materials",
)
ERROR = 0.001


def sized(name: str, size: int, *overrides: str) -> Scene:
    image = [f"image.width={size}", f"image.height={size}", "image.samples=1"]
    return load_scene(configs.path(name), [*image, *overrides]).at(0)


def noise(name: str, assets: Assets) -> str:
    """Seconds on all CPUs for 0.1 % at 256x256; and the noise claimed beside that between two renders."""
    scene = sized(name, 256)
    gbuffer = trace_gbuffer(scene, assets)
    sources = direct_sources(scene, gbuffer, mesh_occluders(scene, assets))
    goal = Goal(ERROR, 1 << 16, len(gbuffer.position))
    wall, cpu = time.perf_counter(), time.process_time()
    first, choice = integrate_adaptively(sources, gbuffer.material, goal, (0,), name)
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    second, _ = integrate_adaptively(sources, gbuffer.material, goal, (1,), name)
    mean = first.radiance.mean()
    claimed = np.sqrt((first.variance + second.variance).mean() / 2) / mean
    seen = np.sqrt(((first.radiance - second.radiance) ** 2).mean() / 2) / mean
    return (
        f"| {name} | {len(scene.lights)} | {choice.samples.mean():.0f} | {choice.samples.max():.0f} "
        f"| {100 * claimed:.3f} % | {100 * seen:.3f} % | {cpu:.1f} | {wall:.1f} |"
    )


def mitsuba(
    name: str, assets: Assets, variant: str, bounces: int, size: int = 64, samples: int = 1024
) -> str:
    """Share of pixels that a z-test accepts, and the difference of the means."""
    scene = sized(name, size)
    theirs = estimate_with_mitsuba(scene, assets, samples, variant=variant, bounces=bounces)
    gbuffer = trace_gbuffer(scene, assets)
    occluders = mesh_occluders(scene, assets)
    sources = [*direct_sources(scene, gbuffer, occluders)]
    if bounces > 1:
        sources.append(BouncedLight(scene, assets, gbuffer, occluders, bounces))
    choice = uniform(strata(samples // 2), len(sources), len(gbuffer.position))
    found, _ = integrate(sources, gbuffer.material, choice, (0,), name)
    order = camera_rays(scene).pixel
    image = np.zeros((2, size * size, 3))
    image[:, gbuffer.pixel] = found.radiance, found.variance
    ours = Estimate(*image[:, order])
    shown = np.isin(order, gbuffer.pixel)
    z = z_scores(ours, theirs)[shown]
    bias = ours.radiance[shown].sum() / theirs.radiance[shown].sum() - 1
    accepted, within = 100 * acceptance(z), 100 * np.mean(np.abs(z) < 3)
    return f"| {name} | {bounces} | {len(z)} | {accepted:.2f} % | {within:.2f} % | {100 * bias:+.3f} % |"


def main() -> None:
    """One table."""
    kind, *names = sys.argv[1:] or ["noise"]
    assets = Assets(open_device(None))
    if kind == "noise":
        print("| scene | lights | samples, mean | most | noise claimed | between two | CPU s | s |")
        print("|---|---|---|---|---|---|---|---|")
        for name in names or SCENES:
            print(noise(name, assets), flush=True)
        return
    variant = best_variant()
    print(f"Mitsuba's {variant}")
    print("| scene | bounces | pixels | accepted | within 3 sigma | difference of the means |")
    print("|---|---|---|---|---|---|")
    for name in names or SCENES:
        for bounces in (1, 3):
            try:
                print(mitsuba(name, assets, variant, bounces), flush=True)
            except CoslobeError as error:
                print(f"| {name} | {bounces} | {error} | | | |", flush=True)


if __name__ == "__main__":
    main()
