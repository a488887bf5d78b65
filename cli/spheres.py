"""`coslobe spheres`: a sphere set for a mesh, fitted for shadows, with its error known."""

from pathlib import Path
from typing import Annotated

import typer

from coslobe.cli.common import DeviceOption, JsonOption, command, print_json, progress, say


@command
def spheres(
    mesh: Annotated[str, typer.Argument(help="PLY, OBJ, STL, GLB or glTF file, or sample:bunny.")],
    count: Annotated[int, typer.Option("-n", "--count", help="Spheres in the finest level.")] = 64,
    method: Annotated[str, typer.Option(help="How to fit: balanced.")] = "balanced",
    quality: Annotated[str, typer.Option(help="fast, or best (about five times slower).")] = "fast",
    mode: Annotated[
        str, typer.Option(help="Where spheres may reach: balanced, inner, outer; default: the method's own.")
    ] = "",
    levels: Annotated[
        int | None, typer.Option(help="Levels of detail to keep, the finest included; default: all.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="The same seed gives the same spheres.")] = 0,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Default: <mesh name>.spheres.json, here.")
    ] = None,
    device: DeviceOption = None,
    json: JsonOption = False,
) -> None:
    """Fit spheres to a mesh; write the sphere file and a preview picture beside it."""
    from coslobe.core.device import open_device
    from coslobe.core.errors import UsageError
    from coslobe.spheresets.files import SUFFIX, write_spheres
    from coslobe.spheresets.fit import cached_spheres
    from coslobe.spheresets.mesh import SAMPLE_BUNNY, load_mesh
    from coslobe.spheresets.preview import write_preview
    from coslobe.spheresets.settings import FitSettings

    settings = FitSettings(count, method, quality, mode, seed, levels)
    if mesh != SAMPLE_BUNNY and not Path(mesh).is_file():
        raise UsageError(f"{mesh}: no such file", f"give a mesh file or {SAMPLE_BUNNY}")
    source = load_mesh(mesh)
    file = output or Path(source.name + SUFFIX)
    picture = file.with_name(file.name.removesuffix(".json").removesuffix(".spheres") + ".spheres.png")
    with progress() as listener:
        tree = cached_spheres(source, settings, metrics=True, device=open_device(device), progress=listener)
        write_spheres(file, tree)
        write_preview(picture, source, tree.finest)
    if json:
        print_json(
            {"file": file, "count": tree.finest.count, "metrics": tree.metrics, "seconds": tree.seconds}
        )
        return
    m = tree.metrics
    found = tree.finest.count, len(tree.levels)
    size = " in ".join(
        f"{n} {noun}{'s' * (n > 1)}" for n, noun in zip(found, ("sphere", "level"), strict=True)
    )
    say(f"{file}: {size}, fitted in {tree.seconds:.1f} s")
    say(f"  silhouettes  IoU {m['silhouette_iou_mean']:.3f} (worst view {m['silhouette_iou_min']:.3f})")
    say(
        f"  volume       IoU {m['volume_iou']:.3f}, {m['outside_volume']:.1%} outside, "
        f"{m['uncovered_volume']:.1%} uncovered"
    )
    say(f"  largest gap  {m['max_gap']:.2%} of the diagonal")
    errors = ", ".join(f"{error:.2%}" for error in m["shadow_rmse_no_contact"])
    say(f"  ground shadow error  {errors} (light radius 0.05, 0.3, 0.8 of the longest side)")
    say(f"{picture}: preview")
