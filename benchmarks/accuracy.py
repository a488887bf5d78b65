"""Errors on the demo's scene and on those of the paper's figures, written to docs/accuracy.md.

Against references with the same spheres (what the masks and integrals cost) and with the true mesh (what the
spheres cost), for matt and glossy surfaces. Minutes on two cores; run it as `python benchmarks/accuracy.py`.
"""

import datetime
from pathlib import Path

import figures
import numpy as np

from coslobe import configs
from coslobe.core.device import Device, select
from coslobe.evaluate.crosscheck import image_shift, render_with_mitsuba
from coslobe.evaluate.direct import direct_light
from coslobe.evaluate.errors import Errors, compare, without_noise
from coslobe.evaluate.occlusion import mesh_occluders, sphere_occluders
from coslobe.evaluate.sampling import strata
from coslobe.render.assets import Assets, world_blockers
from coslobe.render.gbuffer import GBuffer, trace_gbuffer
from coslobe.render.methods import create_method
from coslobe.render.scene import Scene, load_scene

TARGET = Path(__file__).parent.parent / "docs" / "accuracy.md"
SIZE = ("image.width=256", "image.height=256")
GLOSSY_GROUND = "materials.ground={phong: {kd: 0.4, ks: 0.3, exponent: %d}}"
MATERIALS = {
    "Lambert": (4096, ("materials.clay={lambert: {albedo: 0.5}}",)),
    "Phong, e = 50": (4096, (GLOSSY_GROUND % 50,)),
    "Phong, e = 1000": (16384, (GLOSSY_GROUND % 1000, "materials.clay.phong.exponent=1000")),
}
FRAMES = (0, 7, 12, 18)


def at(frame: int, overrides: tuple[str, ...]) -> Scene:
    """The demo's scene, smaller and changed."""
    return load_scene(configs.path("bunny"), (*SIZE, *overrides)).at(frame)


def errors(image: np.ndarray, estimate, chosen: np.ndarray) -> Errors:
    """Over the chosen points."""
    return compare(image[chosen], estimate.radiance[chosen], estimate.variance[chosen])


def percent(value: float | None) -> str:
    """Two significant digits."""
    return "-" if value is None else f"{100 * value:.2g} %"


def same_spheres(device: Device, assets: Assets) -> list[str]:
    """Rows: material, ground and whole picture with the reference's noise."""
    rows = []
    method = create_method("cosine_lobes", device)
    for name, (samples, overrides) in MATERIALS.items():
        scene = at(0, overrides)
        gbuffer = trace_gbuffer(scene, assets)
        image = method.shade(scene, gbuffer, world_blockers(scene, assets)).radiance
        estimate = direct_light(scene, gbuffer, sphere_occluders(scene, assets), strata(samples), (0,))
        cells = [name, str(samples)]
        for chosen in (gbuffer.object == 0, np.ones(len(image), bool)):
            found = errors(image, estimate, chosen)
            assert found.relative_rmse is not None
            assert found.noise is not None
            rest = without_noise(found.relative_rmse, found.noise)
            cells += [percent(found.relative_rmse), percent(found.noise), percent(rest)]
        rows.append("| " + " | ".join(cells) + " |")
        print(rows[-1], flush=True)
    return rows


def true_mesh(device: Device, assets: Assets) -> list[str]:
    """Rows: number of spheres, errors of ground and bunny per frame."""
    rows = []
    method = create_method("cosine_lobes", device)
    references: dict[int, tuple[GBuffer, object]] = {}
    for count in (64, 256):
        for frame in FRAMES:
            scene = at(frame, (f"objects.bunny.spheres.count={count}",))
            if frame not in references:
                gbuffer = trace_gbuffer(scene, assets)
                estimate = direct_light(scene, gbuffer, mesh_occluders(scene, assets), strata(1024), (0,))
                references[frame] = (gbuffer, estimate)
            gbuffer, estimate = references[frame]
            image = method.shade(scene, gbuffer, world_blockers(scene, assets)).radiance
            ground, bunny = (errors(image, estimate, gbuffer.object == index) for index in (0, 1))
            cells = [str(count), str(frame)]
            for found in (ground, bunny):
                cells += [percent(found.relative_rmse), percent(found.bias)]
            rows.append("| " + " | ".join(cells) + " |")
            print(rows[-1], flush=True)
    return rows


def mitsuba(device: Device, assets: Assets) -> list[str]:
    """Rows: quantity, difference from Mitsuba 3."""
    size = ("image.width=96", "image.height=96", "image.samples=16")
    method = create_method("cosine_lobes", device)
    rows = []
    for name, material in (
        ("Lambert", "{lambert: {albedo: 0.7}}"),
        ("Phong, e = 30", "{phong: {kd: 0.3, ks: 0.4, exponent: 30}}"),
    ):
        scene = at(0, (*size, f"materials.ground={material}", "objects.bunny.visible=false"))
        gbuffer = trace_gbuffer(scene, assets)
        ours = gbuffer.image(method.shade(scene, gbuffer, world_blockers(scene, assets)).radiance)
        theirs = render_with_mitsuba(scene, assets, 256)
        rows.append(f"| mean radiance, empty plane, {name} | {percent(ours.mean() / theirs.mean() - 1)} |")
        print(rows[-1], flush=True)
    scene = at(0, (*size, "materials.clay={lambert: {albedo: 0.5}}", "objects.bunny.spheres.count=256"))
    gbuffer = trace_gbuffer(scene, assets)
    ours = gbuffer.image(method.shade(scene, gbuffer, world_blockers(scene, assets)).radiance)
    theirs = render_with_mitsuba(scene, assets, 256)
    right, down = image_shift(ours.sum(axis=-1), theirs.sum(axis=-1))
    rows.append(f"| displacement of the picture with the bunny, pixels | {right:+.3f}, {down:+.3f} |")
    print(rows[-1], flush=True)
    return rows


def main() -> None:
    """Measure and write the page."""
    device = Device(select())
    assets = Assets(device)
    lines = [
        "# Accuracy",
        "",
        f"The demo's scene (`configs/bunny.yaml`) at 256x256, {datetime.date.today()}, on",
        f"{device.info.title}.",
        "Written by `python benchmarks/accuracy.py`. Errors are relative RMSE,",
        "sqrt(mean((I - R)^2)) / mean(R) over pixels that hit a surface. A reference has noise of its own,",
        "which a perfect picture would show; *rest* is what remains when it is taken off in squares.",
        "",
        "## Against the same spheres, frame 0, 64 spheres",
        "",
        "What masks and integrals cost, without the shape of the spheres.",
        "",
        "| material | samples | ground | noise | rest | whole picture | noise | rest |",
        "|---|---|---|---|---|---|---|---|",
        *same_spheres(device, assets),
        "",
        "## Against the true mesh",
        "",
        "What the spheres cost. 1024 samples. The bunny is lit at grazing angles in some frames, where its",
        "own spheres decide about its shadows on itself; contact carries most of the ground's error.",
        "",
        "| spheres | frame | ground | bias | bunny | bias |",
        "|---|---|---|---|---|---|",
        *true_mesh(device, assets),
        "",
        "## Against Mitsuba 3",
        "",
        "The `direct` integrator, an analytic sphere as emitter, the same camera; 256 samples a pixel.",
        "",
        "| quantity | difference |",
        "|---|---|",
        *mitsuba(device, assets),
        "",
        *figures.sections(device),
    ]
    TARGET.write_text("\n".join(lines))


if __name__ == "__main__":
    main()
