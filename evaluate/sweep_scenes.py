"""What each sweep varies, as a change of the scene at a frame."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydantic import ValidationError

from coslobe.core.errors import UsageError
from coslobe.render.fields import Texture
from coslobe.render.scene import Material, Scene


@dataclass(frozen=True)
class Sweep:
    """A parameter and how it is set.

    Attributes
    ----------
    name, label : str
        As `--sweep` and as axes of plots say it.
    values : tuple of float
        Where none are given.
    scene : str
        The shipped scene that is swept where none is given.
    apply : function of (Scene, value)
        The scene with the value set.
    moves_reference : bool
        The value changes what is true, not just how well it is met.
    whole : bool
        Values are whole numbers.
    settings : tuple of str
        What is set in the shipped scene, as by `--set`.
    """

    name: str
    label: str
    values: tuple[float, ...]
    scene: str
    apply: Callable[[Scene, Any], Scene]
    moves_reference: bool = False
    whole: bool = True
    settings: tuple[str, ...] = ()

    def lights(self, value: Any) -> int:
        """How many lights share the samples that one of them had."""
        return value if self.name == "lights" else 1


def parse_values(sweep: Sweep, text: str | None) -> list[float]:
    """The values of a sweep from text like "0,0.001,0.05", ascending; None: its own.

    Raises
    ------
    UsageError
        A part is no number, or nothing is left.
    """
    if text is None:
        return list(sweep.values)
    kind = "whole numbers" if sweep.whole else "numbers"
    hint = f"write {kind} with commas between, as in --values {','.join(f'{v:g}' for v in sweep.values[:3])}"
    values = set()
    for part in text.split(","):
        try:
            value = int(part) if sweep.whole else float(part)
        except ValueError as error:
            raise UsageError(f"--values {text}: {part.strip()!r} is not one of {kind}", hint) from error
        if not math.isfinite(value) or value < 0:
            raise UsageError(f"--values {text}: {part.strip()} must be finite and not negative", hint)
        values.add(value)
    return sorted(values)


def with_seed(scene: Scene, seed: int) -> Scene:
    """The scene with another seed of its sphere fits; sphere sets from files stay."""
    return _objects(scene, lambda spheres: {"seed": spheres.seed + seed} if spheres.file is None else {})


def _threshold(scene: Scene, value: float) -> Scene:
    return _with(scene, shading=_checked(scene.shading, threshold=value))


def _depth(scene: Scene, value: int) -> Scene:
    return _with(scene, shading=_with(scene.shading, mask=_checked(scene.shading.mask, depth=value)))


def _spheres(scene: Scene, value: int) -> Scene:
    if not any(
        obj.mesh is not None and obj.occludes and obj.spheres.file is None for obj in scene.objects.values()
    ):
        raise UsageError("--sweep spheres: no object of the scene has spheres to fit", "give one a mesh")
    return _objects(scene, lambda spheres: {"count": value} if spheres.file is None else {})


def _lights(scene: Scene, value: int) -> Scene:
    """The first light split into `value` alike, around the vertical axis through the camera's target.

    Each has its share of the first one's cross-section and power.
    """
    if value < 1 or not scene.lights:
        raise UsageError(f"--sweep lights: {value} lights cannot be made", "give --values of 1 and more")
    name, light = next(iter(scene.lights.items()))
    sphere = light.sphere
    size: dict[str, Any] = {"radius": sphere.radius / np.sqrt(value)}
    if sphere.intensity is not None:
        size["intensity"] = tuple(part / value for part in sphere.intensity)
    target = np.asarray(scene.camera.look_at.target, np.float64)
    x, y, z = np.asarray(sphere.center, np.float64) - target
    lights = {}
    for k in range(value):
        turn = 2 * np.pi * k / value
        turned = (np.cos(turn) * x + np.sin(turn) * z, y, np.cos(turn) * z - np.sin(turn) * x)
        moved = _checked(sphere, center=tuple(target + turned), **size)
        lights[f"{name} {k + 1}"] = _with(light, sphere=moved)
    return _with(scene, lights=lights | dict(list(scene.lights.items())[1:]))


def _exponent(scene: Scene, value: float) -> Scene:
    """All lobes of this exponent; in a scene without any, Lambert becomes half diffuse and half Phong."""
    glossy = any(material.lambert is None for material in scene.materials.values())
    change = _sharpened if glossy else _glossy
    return _with(
        scene, materials={name: change(material, value) for name, material in scene.materials.items()}
    )


def _sharpened(material: Material, value: float) -> Material:
    if material.phong is not None:
        return _with(material, phong=_checked(material.phong, exponent=value))
    if material.phong_1975 is not None:
        return _with(material, phong_1975=_checked(material.phong_1975, exponent=value))
    if material.lafortune is not None:
        lobes = tuple(_checked(lobe, exponent=value) for lobe in material.lafortune.lobes)
        return _with(material, lafortune=_with(material.lafortune, lobes=lobes))
    return material


def _glossy(material: Material, value: float) -> Material:
    assert material.lambert is not None
    albedo = material.lambert.albedo
    half = 0.4 if isinstance(albedo, Texture) else tuple(part / 2 for part in albedo)
    return _sharpened(Material.model_validate({"phong": {"kd": half, "ks": half, "exponent": 1}}), value)


def _objects(scene: Scene, change: Callable[[Any], dict[str, Any]]) -> Scene:
    objects = {
        name: obj if obj.mesh is None else _with(obj, spheres=_checked(obj.spheres, **change(obj.spheres)))
        for name, obj in scene.objects.items()
    }
    return _with(scene, objects=objects)


def _with(part: Any, **values: Any) -> Any:
    """A part of the scene with other parts in it."""
    return part.model_copy(update=values)


def _checked(part: Any, **values: Any) -> Any:
    """A part of the scene with other values in it.

    Raises
    ------
    UsageError
        A value is not allowed.
    """
    known = {name: getattr(part, name) for name in part.model_fields_set}
    try:
        return type(part).model_validate(known | values)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(key) for key in first["loc"])
        raise UsageError(f"--values: {where} {first['input']}: {first['msg']}", "choose others") from error


SWEEPS: dict[str, Sweep] = {
    sweep.name: sweep
    for sweep in (
        Sweep("ti", "t_i", (0, 1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 5e-2), "fig16", _threshold, whole=False),
        Sweep("depth", "mask depth", (2, 3, 4, 5), "fig17", _depth),
        Sweep("spheres", "spheres per object", (16, 32, 64, 128, 256), "fig17", _spheres),
        Sweep("lights", "lights", (1, 2, 4, 8, 12), "fig17", _lights, moves_reference=True),
        Sweep(
            "exponent",
            "exponent of the lobes",
            (1, 5, 20, 50, 200, 1000),
            "fig17",
            _exponent,
            moves_reference=True,
            whole=False,
            settings=(  # Fig. 17 is seen from beneath, where no highlight shows
                "camera.look_at={origin: [-0.8, 3.2, 1.2], target: [0, 0.2, 0.2]}",
                "camera.fov=50",
            ),
        ),
    )
}


def knee(x: Sequence[float], y: Sequence[float]) -> int | None:
    """Where a curve bends most: the point farthest from the line between its ends (Satopää et al. 2011).

    Both axes are scaled to [0, 1]; None where fewer than three points are known or the curve is straight
    within a tenth.
    """
    if len(x) < 3 or min(x) == max(x) or min(y) == max(y):
        return None
    u = (np.asarray(x, float) - x[0]) / (x[-1] - x[0])
    v = (np.asarray(y, float) - min(y)) / (max(y) - min(y))
    away = np.abs(v - (v[0] + u * (v[-1] - v[0])))
    index = int(away.argmax())
    return index if away[index] > 0.1 else None
