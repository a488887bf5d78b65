"""Light that surfaces throw on one another: path tracing in waves, all paths of a block bounce by bounce."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from coslobe.evaluate.brdf import Vectors, dot
from coslobe.evaluate.integration import Estimate, pair_moments
from coslobe.evaluate.occlusion import Occluders, Segments, entry_distance
from coslobe.evaluate.sampling import Strata, light_caps, light_measure, square_to_cap
from coslobe.evaluate.scattering import Scattering
from coslobe.evaluate.surfaces import Surfaces

if TYPE_CHECKING:
    from coslobe.render.assets import Assets
    from coslobe.render.gbuffer import GBuffer
    from coslobe.render.scene import Scene, SphereLight

SURE_BOUNCES = 3
"""Paths shorter than this always go on; longer ones with the probability of their largest channel."""


class BouncedLight:
    """Light that met two surfaces or more, `bounces` at most: a `Source` of `integrate`.

    Every vertex of a path after the first is lit by every light, in one direction of the light's cap and in
    the direction in which the path goes on, combined with the power heuristic (Veach and Guibas 1995). The
    first direction is stratified. Russian roulette ends long paths without bias.

    Shadow rays are those of direct light: planes and objects that do not occlude block none. Paths, however,
    meet every visible surface, and end where they meet a light.
    """

    decay = 1.0  # of so many dimensions, strata of two do not catch much

    def __init__(
        self, scene: "Scene", assets: "Assets", gbuffer: "GBuffer", occluders: Occluders, bounces: int
    ) -> None:
        self._gbuffer = gbuffer
        self._occluders = occluders
        self._bounces = bounces
        self._lights = [light.sphere for light in scene.lights.values()]
        self._materials = list(scene.materials.values())
        self._surfaces = Surfaces(scene, assets)
        self.cost = 2.5 * (bounces - 1) * (len(self._lights) + 1)  # as measured

    def estimate(self, points: NDArray, grid: Strata, rng: np.random.Generator) -> Estimate:
        """The light that reaches points of the G-buffer by way of other surfaces."""
        u, v = (part.ravel() for part in grid.jittered(rng, len(points)))
        light = self._light(self._gbuffer.some(np.repeat(points, grid.samples)), u, v, rng)
        mean, covariance = pair_moments(np.moveaxis(light.reshape(len(points), grid.samples, 3), -1, 0))
        return Estimate(mean.T, np.einsum("kkn->nk", covariance))

    def _light(self, vertices: "GBuffer", u: NDArray, v: NDArray, rng: np.random.Generator) -> NDArray:
        """One path from each of the vertices, the first direction from (u, v): float64 [n, 3]."""
        light = np.zeros((len(u), 3))
        path, throughput = np.arange(len(u)), np.ones((len(u), 3))
        scattering = Scattering(self._materials, vertices)
        direction = scattering.sample(u, v, rng.random(len(u)))
        value, density = scattering.reflected(direction)
        for bounce in range(2, self._bounces + 1):
            throughput = throughput * _over(value, density)
            if bounce > SURE_BOUNCES:
                throughput = _roulette(throughput, rng)
            alive = np.flatnonzero(throughput.any(axis=1))
            path, throughput, direction = path[alive], throughput[alive], direction[alive]
            start = vertices.some(alive)
            met, distance, vertices = self._surfaces.nearest(start, direction)
            free = distance < self._distance_to_lights(start.position[met], direction[met])
            met, vertices = met[free], vertices.some(np.flatnonzero(free))
            path, throughput = path[met], throughput[met]
            if len(path) == 0:
                break
            scattering = Scattering(self._materials, vertices)
            u, v, w = rng.random((3, len(path)))
            direction = scattering.sample(u, v, w)
            value, density = scattering.reflected(direction)
            going_on = direction, value, density
            for index in range(len(self._lights)):
                light[path] += throughput * self._direct(index, vertices, scattering, going_on, rng)
        return light

    def _direct(
        self,
        index: int,
        vertices: "GBuffer",
        scattering: Scattering,
        going_on: tuple[NDArray, NDArray, NDArray],
        rng: np.random.Generator,
    ) -> NDArray:
        """What the vertices reflect of one light, [n, 3], by a direction to it and the one that goes on.

        `going_on` are the direction in which the path goes on, BRDF times cosine there, and its density.
        """
        sphere = self._lights[index]
        center, n = np.asarray(sphere.center, np.float64), len(vertices.position)
        caps = light_caps(vertices.position, vertices.geometric_normal, center, sphere.radius)
        measure = light_measure(caps, center - vertices.position, sphere.radius)
        u, v = rng.random((2, n, 1))
        towards = np.concatenate(square_to_cap(u, v, caps), axis=1)
        value, density = scattering.reflected(towards)
        weight = 1 / (1 + (density * measure) ** 2) if sphere.radius > 0 else np.ones(n)
        found = value * (weight * measure)[:, None] * self._visible(index, vertices, towards, value)
        if sphere.radius > 0:
            direction, value, density = going_on
            within = np.einsum("ij,ij->i", caps.axis, direction) >= 1 - caps.height
            squared = (density * measure) ** 2
            value = _over(value * within[:, None], density)
            weight = squared / (1 + squared)
            found += value * weight[:, None] * self._visible(index, vertices, direction, value)
        return found * sphere.emission()

    def _visible(self, index: int, vertices: "GBuffer", direction: NDArray, value: NDArray) -> NDArray:
        """Whether vertices see a light in one direction each, bool [n, 1]; looked up where `value` > 0."""
        sphere = self._lights[index]
        center = np.asarray(sphere.center, np.float64)
        at = np.flatnonzero(value.any(axis=1))
        position = vertices.position[at]
        directions = _columns(direction[at])
        reach = entry_distance(position, directions, center, sphere.radius)
        owner, normal = vertices.object[at], vertices.geometric_normal[at]
        wanted = np.ones((len(at), 1), bool)
        place = (index, center, sphere.radius)
        segments = Segments(position, normal, owner, *place, directions, reach, wanted)
        visible = np.zeros((len(direction), 1), bool)
        if len(at):
            visible[at] = ~self._occluders.blocked(segments)
        return visible

    def _distance_to_lights(self, position: NDArray, direction: NDArray) -> NDArray:
        """Where rays enter the first light, [n]; inf where they meet none or start inside."""
        nearest = np.full(len(position), np.inf)
        for sphere in self._lights:
            nearest = np.minimum(nearest, _entry(position, direction, sphere))
        return nearest


def _entry(position: NDArray, direction: NDArray, sphere: "SphereLight") -> NDArray:
    offset = np.asarray(sphere.center, np.float64) - position
    along = dot(offset, _columns(direction))[:, 0]
    distance2 = np.einsum("ij,ij->i", offset, offset)
    beyond = sphere.radius**2 - (distance2 - along**2)
    meets = (along > 0) & (beyond > 0) & (distance2 > sphere.radius**2)
    return np.where(meets, along - np.sqrt(np.maximum(beyond, 0.0)), np.inf)


def _roulette(throughput: NDArray, rng: np.random.Generator) -> NDArray:
    """Paths that carry little end, the others carry more: the same on average."""
    survival = np.minimum(throughput.max(axis=1), 1.0)
    kept = rng.random(len(survival)) < survival
    return np.where(kept[:, None], _over(throughput, survival), 0.0)


def _over(value: NDArray, density: NDArray) -> NDArray:
    """value [n, 3] / density [n], 0 where the value is."""
    return np.divide(value, density[:, None], out=np.zeros_like(value), where=value > 0)


def _columns(vectors: NDArray) -> Vectors:
    return vectors[:, 0:1], vectors[:, 1:2], vectors[:, 2:3]
