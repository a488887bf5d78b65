"""Kernel times of several set-ups on one device, taken in turns: whatever else runs slows all of them."""

import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from coslobe import configs
from coslobe.core.device import Device
from coslobe.evaluate.embree_front import Embree, stratified
from coslobe.evaluate.sampling import light_caps, square_to_cap
from coslobe.render.assets import Assets, world_blockers
from coslobe.render.gbuffer import trace_gbuffer
from coslobe.render.methods import create_method
from coslobe.render.scene import Light, Object, Scene, Transform, load_scene

ROUNDS = 15
WARM_UP = 2
RAYS = 1 << 20

PAPER_FPS = {"fig17a": 15.9, "fig17b": 10.1, "fig17c": 4.75, "fig14": 13.7, "fig16": 17.3, "fig18": 0.16}
"""Whole shading loops on a laptop of 2007 (Core 2 Duo T7500): the 2009 report's figures."""


@dataclass(frozen=True)
class Measured:
    """Seconds of one set-up in each round.

    Attributes
    ----------
    points : int
    seconds : list of float
        By profiling events, without transfers.
    wall : list of float
        Of the whole call that shades, with transfers.
    """

    points: int
    seconds: list[float]
    wall: list[float]

    @property
    def median(self) -> float:
        """Of the rounds' kernel times."""
        return statistics.median(self.seconds)


def ratio(above: Measured, below: Measured) -> float:
    """Median over the rounds of the quotient within a round."""
    return statistics.median(a / b for a, b in zip(above.seconds, below.seconds, strict=True))


def in_turns(tasks: Mapping[str, Callable[[], float]], rounds: int) -> dict[str, list[float]]:
    """Call every task once per round; what they return, by name."""
    found: dict[str, list[float]] = {name: [] for name in tasks}
    for _ in range(rounds):
        for name, task in tasks.items():
            found[name].append(task())
    return found


def measure(device: Device, rounds: int = ROUNDS) -> tuple[dict[str, Measured], float]:
    """All set-ups of `setups`, and how many of Embree's shadow rays a second traces in the same rounds."""
    assets = Assets(device)
    tasks: dict[str, Callable[[], float]] = {}
    points: dict[str, int] = {}
    walls: dict[str, list[float]] = {}
    for name, scene in setups().items():
        gbuffer, blockers = trace_gbuffer(scene, assets), world_blockers(scene, assets)
        method = create_method(scene.shading.method, device)
        points[name], walls[name] = len(gbuffer.position), []

        def shade(method=method, scene=scene, gbuffer=gbuffer, blockers=blockers, wall=walls[name]) -> float:
            start = time.perf_counter()
            seconds = method.shade(scene, gbuffer, blockers).kernel_seconds
            wall.append(time.perf_counter() - start)
            return seconds

        tasks[name] = shade
    tasks["rays"] = _embree(setups()["fig17a"], assets)
    found = in_turns(tasks, WARM_UP + rounds)
    rays = RAYS / statistics.median(found.pop("rays")[WARM_UP:])
    return {
        name: Measured(points[name], seconds[WARM_UP:], walls[name][WARM_UP:])
        for name, seconds in found.items()
    }, rays


def setups() -> dict[str, Scene]:
    """What is timed, by name. The pairs that are compared differ in one thing only."""
    fig17 = [_scene("fig17", frame) for frame in range(3)]
    base = _scene("fig17", 0, "image.width=256", "image.height=256")
    key = base.lights["key"]
    below = _light(key, (0.6, -4.0, 0.4), key.sphere.radius)
    bunny = base.objects["bunny"]
    aside = bunny.model_copy(update={"transform": Transform(translate=(40.0, 0.1, 0.0))})
    ring = [2 * np.pi * k / 32 for k in range(32)]  # of radius 2: lights of radius 0.15 do not meet there
    lights = {f"light{k}": _light(key, (2 * np.cos(a), 4.0, 2 * np.sin(a)), 0.15) for k, a in enumerate(ring)}
    return {
        **{f"fig17{letter}": scene for letter, scene in zip("abc", fig17, strict=True)},
        "fig14": _scene("fig14"),
        "fig16": _scene("fig16"),
        "fig18": _scene("fig18"),
        "spheres 64": _scene("pareto", 0, *SMALL, "objects.bunny.spheres.count=64"),
        "spheres 4096": _scene("pareto", 0, *SMALL, "objects.bunny.spheres.count=4096"),
        "base": base,
        "light that reaches nothing": _changed(base, lights={"key": key, "below": below}),
        "object that shadows nothing": _changed(base, objects={**base.objects, "aside": aside}),
        "lights 1": _changed(base, lights=dict([*lights.items()][:1])),
        "lights 32": _changed(base, lights=lights),
    }


SMALL = ("image.width=256", "image.height=256")


def _scene(name: str, frame: int = 0, *overrides: str) -> Scene:
    return load_scene(configs.path(name), overrides).at(frame)


def _light(light: Light, center: Sequence[float], radius: float) -> Light:
    place = tuple(float(c) for c in center)
    sphere = light.sphere.model_copy(update={"center": place, "radius": radius})
    return light.model_copy(update={"sphere": sphere})


def _changed(
    scene: Scene, *, lights: dict[str, Light] | None = None, objects: dict[str, Object] | None = None
) -> Scene:
    return scene.model_copy(
        update={"lights": scene.lights if lights is None else lights, "objects": objects or scene.objects}
    )


def _embree(scene: Scene, assets: Assets) -> Callable[[], float]:
    """Seconds of RAYS shadow rays from the points of `scene` to its light, prepared beforehand."""
    gbuffer = trace_gbuffer(scene, assets)
    (light,) = (part.sphere for part in scene.lights.values())
    n = len(gbuffer.position)
    center = np.asarray(light.center, np.float64)
    caps = light_caps(gbuffer.position, gbuffer.geometric_normal, center, light.radius)
    directions = square_to_cap(*stratified(RAYS // n, n, np.random.default_rng(0)), caps)
    distance = np.linalg.norm(center - gbuffer.position, axis=1)[:, None, None]
    embree = Embree(scene, assets)
    wanted = np.ones(directions[0].shape, bool)
    rays = embree.rays(gbuffer, np.arange(n), wanted, np.stack(directions, axis=-1) * distance)

    def trace() -> float:
        start = time.perf_counter()
        embree.blocked(rays)
        return (time.perf_counter() - start) * RAYS / wanted.size

    return trace
