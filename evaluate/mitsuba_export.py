"""Scenes as Mitsuba's XML, with everything that a person needs to render them on their own."""

import shutil
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from coslobe.core.errors import CoslobeError
from coslobe.core.files import write_text
from coslobe.evaluate import mitsuba_lobes
from coslobe.evaluate.mitsuba_scene import Description, LookAt, describe, path_integrator

if TYPE_CHECKING:
    from coslobe.evaluate.reference import OccluderKind
    from coslobe.render.assets import Assets
    from coslobe.render.scene import SceneFile


def export_frames(
    scene_file: "SceneFile",
    folder: Path,
    *,
    frames: Sequence[int],
    assets: "Assets",
    samples: int,
    occluders: "OccluderKind" = "mesh",
    bounces: int = 1,
) -> list[Path]:
    """Write frames for Mitsuba 3 into `folder`/0000 and so on; returns the paths of their scene.xml.

    Beside it lie the meshes, the textures and `render.py`, which makes the BSDF of cosine lobes known and
    renders. Mitsuba itself is not needed for writing.

    Raises
    ------
    CoslobeError
        Mitsuba cannot express the scene, or a file cannot be written.
    """
    written = []
    for index in frames:
        place = folder / f"{index:04d}"
        scene = scene_file.at(index)
        try:
            place.mkdir(parents=True, exist_ok=True)
            settings = {"samples": samples, "integrator": path_integrator(bounces), "occluders": occluders}
            description = describe(scene, assets, place, **settings)
            shutil.copyfile(mitsuba_lobes.__file__, place / "render.py")
        except OSError as error:
            message = f"{place}: cannot be written ({error.strerror or error})"
            raise CoslobeError(message, "choose another folder") from error
        write_text(place / "scene.xml", to_xml(description, place))
        written.append(place / "scene.xml")
    return written


ELEMENTS = {
    "scene": "scene",
    "perspective": "sensor",
    "hdrfilm": "film",
    "independent": "sampler",
    "box": "rfilter",
    "area": "emitter",
    "point": "emitter",
    "sphere": "shape",
    "rectangle": "shape",
    "ply": "shape",
    "bitmap": "texture",
    "diffuse": "bsdf",
    "twosided": "bsdf",
    mitsuba_lobes.PLUGIN: "bsdf",
    "direct": "integrator",
    "path": "integrator",
}
"""XML element of every plugin that `describe` uses."""


def to_xml(description: Description, folder: Path) -> str:
    """A description as a Mitsuba scene file; files are named relative to `folder`."""
    root = _element(description, None, folder)
    root.set("version", "3.0.0")
    ET.indent(root)
    return ET.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def _element(value: Any, name: str | None, folder: Path) -> ET.Element:
    if isinstance(value, dict) and value["type"] == "rgb":
        return ET.Element("rgb", _named(name, " ".join(map(repr, map(float, value["value"])))))
    if isinstance(value, dict):
        kind = value["type"]
        element = ET.Element(ELEMENTS[kind], {} if name is None else {"name": name})
        if kind != "scene":
            element.set("type", kind)
        for key, part in value.items():
            if key != "type":
                element.append(_element(part, key, folder))
        return element
    if isinstance(value, LookAt | np.ndarray):
        element = ET.Element("transform", {"name": name or ""})
        if isinstance(value, LookAt):
            places = {key: ", ".join(map(repr, getattr(value, key))) for key in ("origin", "target", "up")}
            ET.SubElement(element, "lookat", places)
        else:
            ET.SubElement(element, "matrix", {"value": " ".join(map(repr, value.ravel().tolist()))})
        return element
    if isinstance(value, list):
        x, y, z = map(repr, map(float, value))
        return ET.Element("point", {"name": name or "", "x": x, "y": y, "z": z})
    if isinstance(value, Path):
        return ET.Element("string", _named(name, str(value.relative_to(folder))))
    tag = {bool: "boolean", int: "integer", float: "float", str: "string"}[type(value)]
    return ET.Element(tag, _named(name, str(value).lower() if isinstance(value, bool) else str(value)))


def _named(name: str | None, value: str) -> dict[str, str]:
    return {"name": name or "", "value": value}
