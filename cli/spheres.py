"""`coslobe spheres`: a sphere set for a mesh, fitted for shadows, with its error known."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from coslobe.cli.common import DeviceOption, JsonOption, command, print_json, progress, say

FITTING = ("count", "method", "quality", "mode", "levels", "seed", "output", "export")  # not with --compare


@command
def spheres(
    context: typer.Context,
    mesh: Annotated[
        str, typer.Argument(metavar="MESH", help="PLY, OBJ, STL, GLB or glTF file, or sample:bunny.")
    ],
    count: Annotated[int, typer.Option("-n", "--count", help="Spheres in the finest level.")] = 64,
    method: Annotated[
        str,
        typer.Option(
            help="balanced: as much missing as added, for shadows; variational: an outer cover of least "
            "volume; medial: merged balls of the medial axis."
        ),
    ] = "balanced",
    quality: Annotated[str, typer.Option(help="fast, or best (several times slower).")] = "fast",
    mode: Annotated[
        str,
        typer.Option(
            help="balanced: on both sides of the surface; inner: never outside; outer: all of the surface "
            "is covered.",
            show_default="the method's own",
        ),
    ] = "",
    levels: Annotated[
        int | None,
        typer.Option(help="Levels of detail to keep, the finest included.", show_default="all"),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="The same seed gives the same spheres.")] = 0,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="FILE", show_default="<mesh name>.spheres.json, here"),
    ] = None,
    export: Annotated[
        str | None,
        typer.Option(
            metavar="sph|glb",
            help="Also write a file for other programs, beside the output: the bounding tree in Bradshaw's "
            "flat order, or the finest level as coloured balls.",
        ),
    ] = None,
    compare: Annotated[
        tuple[Path, Path] | None,
        typer.Option(
            metavar="A B",
            exists=True,
            dir_okay=False,
            help="Fit nothing; measure two sphere files against MESH and print the figures side by side.",
        ),
    ] = None,
    device: DeviceOption = None,
    json: JsonOption = False,
) -> None:
    """Fit spheres to a mesh; write the sphere file and a preview picture beside it."""
    from coslobe.core.device import open_device
    from coslobe.core.errors import UsageError
    from coslobe.spheresets import export as exports
    from coslobe.spheresets.files import SUFFIX, write_spheres
    from coslobe.spheresets.fit import cached_spheres
    from coslobe.spheresets.mesh import SAMPLE_BUNNY, load_mesh
    from coslobe.spheresets.preview import write_preview
    from coslobe.spheresets.settings import FitSettings

    settings = FitSettings(count, method, quality, mode, seed, levels)
    if export is not None and export not in exports.FORMATS:
        raise UsageError(f"no export {export!r}", f"export can be {' or '.join(exports.FORMATS)}")
    if mesh != SAMPLE_BUNNY and not Path(mesh).is_file():
        raise UsageError(f"{mesh}: no such file", f"give a mesh file or {SAMPLE_BUNNY}")
    if compare is not None:
        given = [name for name in FITTING if _is_given(context, name)]
        if given:
            raise UsageError(f"--compare fits nothing: --{given[0]} has no effect", f"leave out --{given[0]}")
        _compare(mesh, compare, device, json)
        return
    source = load_mesh(mesh)
    file = output or Path(source.name + SUFFIX)
    beside = file.name.removesuffix(".json").removesuffix(".spheres") + ".spheres"
    picture, exported = (file.with_name(f"{beside}.{suffix}") for suffix in ("png", export))
    with progress() as listener:
        tree = cached_spheres(source, settings, metrics=True, device=open_device(device), progress=listener)
        write_spheres(file, tree)
        write_preview(picture, source, tree.finest)
        if export is not None:
            exports.FORMATS[export](exported, tree)
    if json:
        document = {
            "file": file, "count": tree.finest.count, "metrics": tree.metrics, "seconds": tree.seconds
        }  # fmt: skip
        print_json(document | ({"export": exported} if export else {}))
        return
    m = tree.metrics
    size = f"{_many(tree.finest.count, 'sphere')} in {_many(len(tree.levels), 'level')}"
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
    if export:
        say(f"{exported}: export")


def _many(count: int, noun: str) -> str:
    return f"{count} {noun}{'s' * (count > 1)}"


def _is_given(context: typer.Context, name: str) -> bool:
    """Whether the user wrote the option: its value alone may equal the default."""
    source = context.get_parameter_source(name)
    return source is not None and source.name == "COMMANDLINE"


def _compare(source: str, files: Sequence[Path], device: str | None, json: bool) -> None:
    """Measure sphere files against one mesh; print their figures."""
    import warnings

    from coslobe.core.device import open_device
    from coslobe.spheresets.compare import measure_all, side_by_side
    from coslobe.spheresets.files import mismatch, read_spheres
    from coslobe.spheresets.mesh import load_mesh

    trees = [read_spheres(file) for file in files]
    mesh = load_mesh(source)
    for file, tree in zip(files, trees, strict=True):
        if complaint := mismatch(tree, mesh):
            warnings.warn(f"{file}: {complaint}", stacklevel=1)
    with progress() as listener:
        metrics = measure_all(mesh, [tree.finest for tree in trees], open_device(device), listener)
    rows = side_by_side(metrics)
    if json:
        sets = [
            {
                "file": file,
                "mesh": tree.mesh.file,
                "method": tree.method,
                "quality": tree.quality,
                "mode": tree.mode,
                "seed": tree.seed,
                "count": tree.finest.count,
                "seconds": tree.seconds,
                "metrics": measured,
            }
            for file, tree, measured in zip(files, trees, metrics, strict=True)
        ]
        better = {row.name: None if row.better is None else "AB"[row.better] for row in rows}
        print_json(
            {"mesh": source if source.startswith("sample:") else Path(source), "sets": sets, "better": better}
        )
        return
    for letter, file, tree in zip("AB", files, trees, strict=True):
        fit = f"{tree.method} ({tree.quality}, {tree.mode}), seed {tree.seed}, {tree.seconds:.1f} s"
        say(f"{letter}  {file}: {_many(tree.finest.count, 'sphere')}, {fit}")
    width = max(len(row.name) for row in rows)
    say(f"\n{'':{width}} {'A':>10}   {'B':>10}")
    for row in rows:
        cells = (f"{value:>10.4f} {'*' if row.better == k else ' '}" for k, value in enumerate(row.values))
        say(f"{row.name:{width}} {' '.join(cells)}".rstrip())
    say("* better: larger for IoU, else nearer to 0; all measured now, against this mesh")
