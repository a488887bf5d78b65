"""Which frames to render: the range asked for, less the frames that are there with the same settings."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from coslobe.core import cache
from coslobe.core.device import Device, DeviceInfo
from coslobe.core.errors import UsageError
from coslobe.core.progress import SILENT, Progress
from coslobe.core.version import VERSION
from coslobe.render.assets import Assets
from coslobe.render.images import stored_attributes
from coslobe.render.scene import Scene, SceneFile
from coslobe.render.scenepaths import suggestion

METHOD_LAYERS = ("irradiance", "products", "mask_leaves")  # which the lighting method makes
LAYERS = (*METHOD_LAYERS, "object", "normal", "position", "depth")


@dataclass(frozen=True)
class PlannedFrame:
    """A frame and its files.

    Attributes
    ----------
    index : int
    exr, png : Path
    ply : Path
        Of the vertices, where light is computed there.
    settings : str
        Hash of everything that the pixels depend on; stored in the EXR file.
    done : bool
        Both files are there, made with these settings.
    points : int or None
        Shaded points of a frame that is done.
    """

    index: int
    exr: Path
    png: Path
    ply: Path
    settings: str
    done: bool
    points: int | None


def select_frames(text: str | None, count: int) -> list[int]:
    """The frames that `--frames` names: "A:B[:S]" like a Python slice, or one number; None: all `count`.

    Raises
    ------
    UsageError
        The range is malformed or selects nothing.
    """
    if text is None:
        return list(range(count))
    hint = f"the scene has frames 0 to {count - 1}; write A:B, A:B:STEP or one number"
    parts = text.split(":")
    if (
        len(parts) > 3
        or not all(re.fullmatch(r"\s*([+-]?\d{1,15})?\s*", part) for part in parts)
        or not text.strip()
    ):
        raise UsageError(f"--frames {text}: not a range of frames", hint)
    numbers = [int(part) if part.strip() else None for part in parts]
    if len(numbers) == 1:
        assert numbers[0] is not None
        if not -count <= numbers[0] < count:
            raise UsageError(f"--frames {text}: no such frame", hint)
        return [numbers[0] % count]
    if numbers[2:] == [0]:
        raise UsageError(f"--frames {text}: the step must not be 0", hint)
    frames = list(range(*slice(*numbers).indices(count)))
    if not frames:
        raise UsageError(f"--frames {text}: selects no frame", hint)
    return frames


def check_layers(names: Sequence[str]) -> tuple[str, ...]:
    """`names` without repetition, in the order of the file format.

    Raises
    ------
    UsageError
        There is no such layer.
    """
    for name in names:
        if name not in LAYERS:
            raise UsageError(f"--layers {name}: no such layer{suggestion(name, LAYERS)}")
    return tuple(name for name in LAYERS if name in names)


def plan_frames(
    scene_file: SceneFile,
    folder: Path,
    frames: Sequence[int],
    *,
    device: DeviceInfo,
    layers: Sequence[str],
    resume: bool,
    assets: Assets,
) -> list[PlannedFrame]:
    """What to do for each of `frames` with the pictures in `folder`; validates the scene at all of them.

    Raises
    ------
    InvalidInput
        The scene is wrong at one of the frames, or a file that it names cannot be used.
    """
    planned = []
    for index in frames:
        exr = folder / f"beauty.{index:04d}.exr"
        png = exr.with_suffix(".png")
        ply = folder / f"vertices.{index:04d}.ply"
        scene = scene_file.at(index)
        settings = settings_hash(scene, assets, device, layers)
        beside = (png, ply) if scene.shading.at == "vertices" else (png,)
        found = stored_attributes(exr) if resume and all(file.is_file() for file in beside) else {}
        done = found.get("config_sha256") == settings
        points = found.get("points") if done else None
        planned.append(PlannedFrame(index, exr, png, ply, settings, done, points))
    return planned


# The rooms whose code pixels depend on.
CODE = ("core", "spheresets", "spheresets.kernels", "tables", "render", "render.kernels", "render.methods")


def settings_hash(scene: Scene, assets: Assets, device: DeviceInfo, layers: Sequence[str]) -> str:
    """Identity of a picture: the scene with its files' contents, the device, the layers, and the code.

    Where the files lie does not matter.
    """
    data = scene.model_dump(mode="json")
    for name, obj in scene.objects.items():
        data["objects"][name] |= assets.contents(obj)
    data["materials"] = {name: assets.material_contents(part) for name, part in scene.materials.items()}
    order = [list(part) for part in (scene.materials, scene.lights, scene.objects)]
    runtime = (device.platform, device.version, device.name, device.vector_width)
    return cache.digest(VERSION, cache.code_digest(*CODE), data, order, runtime, list(layers))


def preview(
    scene_file: SceneFile,
    out_dir: Path,
    *,
    frames: Sequence[int],
    device: Device,
    layers: Sequence[str] = (),
    resume: bool = True,
    progress: Progress = SILENT,
) -> dict[str, Any]:
    """What `render_sequence` would do with the same arguments; nothing is rendered, fitted or written.

    Returns
    -------
    dict
        frames: [{index, file, resumed}]; points: the most that a frame can have; spheres: [{object, source}],
        where the source says in words whether the set is read, cached, or still has to be fitted.
    """
    assets = Assets(device, progress)
    plan = plan_frames(
        scene_file,
        out_dir / "frames",
        frames,
        device=device.info,
        layers=layers,
        resume=resume,
        assets=assets,
    )
    image = scene_file.description.image
    return {
        "frames": [{"index": part.index, "file": part.exr, "resumed": part.done} for part in plan],
        "points": image.width * image.height * image.samples,
        "spheres": [
            {"object": name, "source": assets.spheres_source(obj)}
            for name, obj in scene_file.at(frames[0]).objects.items()
            if obj.occludes
        ],
    }
