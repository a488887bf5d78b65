"""The scene file: validated objects, and the scene at each frame.

The attribute docstrings are the user's documentation: `coslobe schema` shows them in editors.
"""

import math
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, Field, ValidationError, model_validator

from coslobe.core.errors import InvalidInput, UsageError
from coslobe.render.animation import Animation, Track, animated, put, read_tracks
from coslobe.render.brdf_fits import read_fit
from coslobe.render.fields import (
    LARGEST,
    NUMBER,
    WHOLE,
    Colour,
    Count,
    File,
    MeshFile,
    Name,
    NotNegative,
    Number,
    Part,
    Positive,
    Source,
    Switch,
    Texture,
    VaryingColour,
    VaryingNotNegative,
    VaryingVector,
    Vector,
    wrong,
)
from coslobe.render.problems import Problem, problems_of, report
from coslobe.render.scenepaths import UnknownPath, follow, suggestion
from coslobe.render.yamlfile import Document, parse_yaml, read_yaml
from coslobe.spheresets.settings import FitSettings


def _one_of(*keys: str) -> ConfigDict:
    """Tells editors that exactly one of `keys` must be there."""
    return ConfigDict(json_schema_extra={"oneOf": [{"required": [key]} for key in keys]})


class LookAt(Part):
    """A camera's place and direction."""

    origin: Vector
    """The pinhole."""
    target: Vector
    """The point in the centre of the image."""
    up: Vector = (0.0, 1.0, 0.0)
    """The direction that is up in the image."""

    @model_validator(mode="after")
    def _check_directions(self) -> "LookAt":
        forward = np.subtract(self.target, self.origin)
        if not forward.any():
            raise wrong("origin and target must differ")
        right = np.linalg.norm(np.cross(forward, self.up))
        if right <= 1e-9 * np.linalg.norm(forward) * np.linalg.norm(self.up):
            raise wrong("up must not be parallel to the viewing direction")
        return self


class Camera(Part):
    """A pinhole camera with Mitsuba 3's conventions."""

    look_at: LookAt
    """Where the camera stands and looks."""
    fov: Annotated[float, Field(gt=0, lt=180), NUMBER]
    """Field of view in degrees along `fov_axis`."""
    fov_axis: Literal["x", "y", "smaller", "larger", "diagonal"] = "x"
    """The image axis that `fov` belongs to, as in Mitsuba 3."""


class Image(Part):
    """Size and sampling of the image."""

    width: Annotated[int, Field(ge=1, le=65536), WHOLE]
    """Pixels."""
    height: Annotated[int, Field(ge=1, le=65536), WHOLE]
    """Pixels."""
    samples: Count = 1
    """Samples per pixel: 1 is the pixel's centre; n is a fixed stratified pattern with a box filter."""


class Frames(Part):
    """The frames of the sequence, numbered from 0."""

    frames: Annotated[int, Field(ge=1, le=1_000_000), WHOLE] = 1
    """How many frames there are."""
    fps: Positive = 30.0
    """Frames per second of the video."""


class Mask(Part):
    """The bit mask of what of a light is visible from a point."""

    depth: Annotated[int, Field(ge=2, le=5), WHOLE] = 5
    """Levels of the mask's quadtree: 2^depth cells along each side."""
    mode: Literal["aggressive", "conservative", "centre"] = "centre"
    """Which cells of a row a blocker covers: those wholly inside, all it touches, or by their centres."""


class Paper(Part):
    """The lobes of `estimator: paper`."""

    light_lobes: Literal["energy", "unit"] = "energy"
    """Of lights: energy conserves theirs; unit is the amplitude 1 of the paper, up to 4 % too bright."""
    products: Literal["energy", "l2"] = "energy"
    """Of two lobes: energy conserves the integral of the product; l2 is the paper's fit."""


class Shading(Part):
    """How light is computed."""

    at: Literal["pixels", "vertices"] = "pixels"
    """Where light is computed: at each pixel's samples, or at mesh vertices and interpolated between them."""
    method: Literal["cosine_lobes"] = "cosine_lobes"
    """The lighting method."""
    estimator: Literal["accurate", "paper"] = "accurate"
    """How the visible part of a light is integrated: exactly but for the mask, or as the 2009 paper does."""
    paper: Paper = Paper()
    """The lobes of `estimator: paper`."""
    mask: Mask = Mask()
    """The visibility mask."""
    threshold: NotNegative = 0.0
    """t_i: parts of the light whose integral for unit radiance is below it are dropped."""
    time_budget: Positive | None = None
    """Seconds of shading per frame: where it takes longer, t_i is raised. The machine decides."""


class Lambert(Part):
    """Diffuse reflection: albedo / pi."""

    albedo: VaryingColour
    """Share of the light that is reflected: a number, [r, g, b] or a texture."""


class Phong(Part):
    """Modified Phong: kd / pi + ks (n + 2) / (2 pi) max(r.l, 0)^n."""

    kd: VaryingColour
    """Diffuse reflectance: a number, [r, g, b] or a texture."""
    ks: VaryingColour
    """Specular reflectance: a number, [r, g, b] or a texture."""
    exponent: VaryingNotNegative
    """n: the higher, the sharper the highlight."""


class Phong1975(Part):
    """Phong as it was: reflects kd max(n.l, 0) + ks max(r.l, 0)^n, the cosine to the normal in kd only."""

    kd: VaryingColour
    """Diffuse factor, not divided by pi."""
    ks: VaryingColour
    """Specular factor."""
    exponent: VaryingNotNegative
    """n: the higher, the sharper the highlight."""


class LafortuneLobe(Part):
    """rho max(c_x v_x l_x + c_y v_y l_y + c_z v_z l_z, 0)^n in the tangent frame, whose z is the normal."""

    rho: VaryingColour
    """Scale in 1/sr: a number, [r, g, b] or a texture."""
    c: VaryingVector
    """[-1, -1, 1]: mirror; [1, 1, 1]: back; |c_z| < |c_x|: off-specular; c_x != c_y: anisotropic."""
    exponent: VaryingNotNegative
    """n: the higher, the sharper the highlight."""

    @model_validator(mode="after")
    def _check_size(self) -> "LafortuneLobe":
        constant = [abs(value) for value in self.c if not isinstance(value, Texture)]
        if len(constant) == 3 and max(constant) == 0:
            raise wrong("c must not be [0, 0, 0]")
        if len(constant) < 3 or isinstance(self.rho, Texture) or isinstance(self.exponent, Texture):
            return self  # which is checked where the textures are
        size = self.exponent * math.log10(max(constant)) + math.log10(max(*self.rho, sys.float_info.min))
        if size > math.log10(LARGEST):
            raise wrong(f"rho |c|^exponent = 10^{size:.0f} is too large; scale c to a largest component of 1")
        return self


class Lafortune(Part):
    """kd / pi and any number of cosine lobes, or a row of a table of fits."""

    kd: VaryingColour = (0.0, 0.0, 0.0)
    """Diffuse reflectance: a number, [r, g, b] or a texture."""
    lobes: tuple[LafortuneLobe, ...] = ()
    """Added to one another."""
    tangent: Vector | None = None
    """x of the tangent frame in the object's coordinates; by default the direction of u."""
    fit: Annotated[File | None, Field(exclude=True)] = None
    """A CSV file with the columns name, kd_r, kd_g, kd_b, ks_r, ks_g, ks_b, Cxy, Cz, sharpness."""
    name: Annotated[str | None, Field(exclude=True)] = None
    """The row of `fit`."""

    @model_validator(mode="after")
    def _read_fit(self) -> "Lafortune":
        if self.tangent is not None and not any(self.tangent):
            raise wrong("tangent must not be [0, 0, 0]")
        given = self.model_fields_set
        if (self.fit is None) != (self.name is None) or bool({"kd", "lobes"} & given) == bool(self.fit):
            raise wrong("must hold either kd and lobes, or fit and name")
        if self.fit is None or self.name is None:
            return self
        try:
            fit = read_fit(Path(self.fit), self.name)
        except InvalidInput as error:
            raise wrong(str(error)) from error
        lobe = LafortuneLobe.model_validate({"rho": fit.rho, "c": fit.c, "exponent": fit.exponent})
        return self.model_copy(update={"kd": fit.kd, "lobes": (lobe,)})


class Material(Part):
    """How a surface reflects light: exactly one kind."""

    model_config = _one_of("lambert", "phong", "phong_1975", "lafortune")

    lambert: Lambert | None = None
    phong: Phong | None = None
    phong_1975: Phong1975 | None = None
    lafortune: Lafortune | None = None

    @model_validator(mode="after")
    def _check_kind(self) -> "Material":
        kinds = (self.lambert, self.phong, self.phong_1975, self.lafortune)
        if sum(kind is not None for kind in kinds) != 1:
            raise wrong("must hold exactly one of lambert, phong, phong_1975, lafortune")
        return self

    @property
    def kind(self) -> Lambert | Phong | Phong1975 | Lafortune:
        """The one that is there."""
        kind = self.lambert or self.phong or self.phong_1975 or self.lafortune
        assert kind is not None
        return kind

    @property
    def pictures(self) -> frozenset[Source]:
        """What its textures look up."""
        return frozenset(texture.source for texture in _textures(self.kind))

    @property
    def anisotropic(self) -> bool:
        """Whether the direction of the tangent matters."""
        return self.lafortune is not None and any(lobe.c[0] != lobe.c[1] for lobe in self.lafortune.lobes)

    @property
    def tangent(self) -> tuple[float, float, float] | None:
        """The x of its tangent frame in the object's coordinates; None: the direction of u."""
        return self.lafortune.tangent if self.lafortune else None


def _textures(part: Any) -> Iterator[Texture]:
    if isinstance(part, Texture):
        yield part
    elif isinstance(part, Part):
        for name in type(part).model_fields:
            yield from _textures(getattr(part, name))
    elif isinstance(part, tuple):
        for item in part:
            yield from _textures(item)


class SphereLight(Part):
    """A sphere that sends out the same radiance everywhere. It is not drawn, but blocks other lights."""

    model_config = _one_of("radiance", "intensity")

    center: Vector
    """Centre in the world."""
    radius: NotNegative
    """The larger, the softer the shadows. 0: a point, which casts hard shadows and needs intensity."""
    radiance: Colour | None = None
    """Emitted radiance: a number or [r, g, b]."""
    intensity: Colour | None = None
    """Radiant intensity instead: radiance times pi radius^2. The scene stays as bright at any radius."""

    @model_validator(mode="after")
    def _check_emission(self) -> "SphereLight":
        if (self.radiance is None) == (self.intensity is None):
            raise wrong("must hold exactly one of radiance, intensity")
        if self.radius == 0 and self.intensity is None:
            raise wrong("a light of radius 0 is a point: give intensity instead of radiance")
        return self

    def emission(self) -> NDArray[np.float64]:
        """Radiance [3], or the intensity of a point."""
        if self.intensity is None:
            return np.asarray(self.radiance, np.float64)
        intensity = np.asarray(self.intensity, np.float64)
        return intensity if self.radius == 0 else intensity / (np.pi * self.radius**2)


class Light(Part):
    """A light."""

    sphere: SphereLight


class Plane(Part):
    """A square in y = 0, centred, two-sided. It never occludes."""

    size: Positive
    """Side length."""
    resolution: Count = 1
    """Cells along each side, for shading at vertices."""


class Spheres(Part):
    """The sphere set that stands for a mesh as an occluder: fitted as said, or read from a file."""

    count: Count = 64
    """How many spheres."""
    method: Literal["balanced", "variational", "medial"] = "balanced"
    """How they are fitted."""
    quality: Literal["fast", "best"] = "fast"
    """How much time the fit may take."""
    seed: Annotated[int, Field(ge=0), WHOLE] = 0
    """Seed of the fit's random numbers."""
    file: File | None = None
    """A sphere file (NAME.spheres.json) instead of a fit."""

    @model_validator(mode="after")
    def _check_source(self) -> "Spheres":
        if self.file is not None and len(self.model_fields_set) > 1:
            raise wrong("holds either file or the settings of a fit, not both")
        return self

    def settings(self) -> FitSettings:
        """The fit that is asked for."""
        return FitSettings(self.count, self.method, self.quality, seed=self.seed)


class Transform(Part):
    """Scale, then rotate about x, y and z in that order, then translate."""

    translate: Vector = (0.0, 0.0, 0.0)
    """Applied last."""
    rotate_x: Number = 0.0
    """Degrees."""
    rotate_y: Number = 0.0
    """Degrees."""
    rotate_z: Number = 0.0
    """Degrees."""
    scale: Positive = 1.0
    """Uniform; applied first."""

    def matrix(self) -> NDArray[np.float64]:
        """Object to world for column vectors, [4, 4]."""
        (sx, sy, sz), (cx, cy, cz) = (
            function(np.radians([self.rotate_x, self.rotate_y, self.rotate_z]))
            for function in (np.sin, np.cos)
        )
        about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
        about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
        about_z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
        matrix = np.eye(4)
        matrix[:3, :3] = about_z @ about_y @ about_x * self.scale
        matrix[:3, 3] = self.translate
        return matrix


class Object(Part):
    """Something that is seen: a plane or a mesh, with a material."""

    model_config = _one_of("plane", "mesh")

    plane: Plane | None = None
    mesh: MeshFile | None = None
    """A mesh file, relative to the scene file, or sample:bunny."""
    material: str
    """The name of a material."""
    spheres: Spheres = Spheres()
    """The sphere set that occludes in the mesh's place."""
    transform: Transform = Transform()
    """From the object's coordinates to the world."""
    occludes: Switch = Field(default_factory=lambda data: data.get("mesh") is not None)
    """False: receives only, as a room around the scene. By default true for meshes."""
    visible: Switch = True
    """False: neither shows nor occludes."""
    normals: Literal["smooth", "flat"] = "smooth"
    """smooth: the file's normals, else angle-weighted averages; flat: each triangle's own."""

    @model_validator(mode="after")
    def _check_kind(self) -> "Object":
        if (self.plane is None) == (self.mesh is None):
            raise wrong("must hold exactly one of plane, mesh")
        if self.plane is not None and self.occludes:
            raise wrong("a plane never occludes; leave occludes out")
        if self.plane is not None and "spheres" in self.model_fields_set:
            raise wrong("a plane has no spheres; leave spheres out")
        return self


class Scene(Part):
    """Everything that one frame needs."""

    camera: Camera
    """The viewer."""
    image: Image
    """The picture's size and sampling."""
    shading: Shading = Shading()
    """How light is computed."""
    materials: dict[Name, Material]
    """Materials by name."""
    lights: dict[Name, Light]
    """Lights by name."""
    objects: dict[Name, Object]
    """Objects by name."""


class Description(Scene):
    """A scene file of coslobe. Relative paths in it are relative to the file."""

    model_config = ConfigDict(title="coslobe scene")

    coslobe: Annotated[Literal[1], WHOLE]
    """Version of the format."""
    sequence: Frames = Frames()
    """The frames."""
    animation: tuple[Animation, ...] = ()
    """What changes from frame to frame."""


@dataclass(frozen=True)
class SceneFile:
    """A scene file that was read and found valid.

    Attributes
    ----------
    path : Path
        As given.
    document : Document
        Plain data after `--set`, with places.
    description : Description
        The validated file, before animation.
    tracks : tuple of Track
        Its animation, ready to evaluate.
    """

    path: Path
    document: Document
    description: Description
    tracks: tuple[Track, ...]

    @property
    def name(self) -> str:
        """The file's name without its suffix."""
        return self.path.stem

    @property
    def data(self) -> dict[str, Any]:
        """The file as plain data, after `--set`."""
        return self.document.data

    @property
    def frames(self) -> int:
        """How many frames the sequence has."""
        return self.description.sequence.frames

    @property
    def fps(self) -> float:
        """Frames per second."""
        return self.description.sequence.fps

    def at(self, frame: int) -> Scene:
        """The scene at `frame`, with the animation applied and paths made absolute.

        Raises
        ------
        InvalidInput
            Animated values do not go together, as a camera that stands in its target.
        """
        data = animated(self.data, self.tracks, frame)
        data = {key: value for key, value in data.items() if key in Scene.model_fields}
        try:
            return Scene.model_validate(data, context=_context(self.path))
        except ValidationError as error:
            problems = problems_of(error, Scene, data)
            raise report(self.document, [problem.at_frame(frame) for problem in problems]) from error


def load_scene(path: str | Path, overrides: Sequence[str] = ()) -> SceneFile:
    """Read and validate a scene file; `overrides` are "PATH=VALUE", the value written as in YAML.

    Raises
    ------
    InvalidInput
        The file or a value is wrong; the message lists every error with its place.
    UsageError
        An override is malformed or its path does not exist.
    """
    path = Path(path)
    document = read_yaml(path)
    if not isinstance(document.data, dict):
        message = f"{document.place(())}: a scene file must be a mapping of keys to values"
        raise InvalidInput(message, "docs/scene_file.md shows one")
    for override in overrides:
        document = _overridden(document, override)
    problems: list[Problem] = []
    description = None
    try:
        description = Description.model_validate(document.data, context=_context(path))
    except ValidationError as error:
        problems += problems_of(error, Description, document.data)
    problems += _dangling_materials(document.data)
    tracks, animation_problems = read_tracks(document.data, Description)
    problems += animation_problems
    if description is None or problems:
        raise report(document, problems)
    return SceneFile(path, document, description, tracks)


def _context(path: Path) -> dict[str, Any]:
    return {"folder": path.parent}


def _overridden(document: Document, override: str) -> Document:
    """The document with one `--set PATH=VALUE` applied."""
    dotted, equals, text = override.partition("=")
    if not equals:
        raise UsageError(f"--set {override}: no value", "write --set PATH=VALUE")
    try:
        path, _ = follow(Description, document.data, dotted)
        value = parse_yaml(text, f"--set {dotted}").data
    except UnknownPath as error:
        raise UsageError(f"--set {override}: {error}", "coslobe schema lists all keys") from error
    except InvalidInput as error:
        raise UsageError(str(error), "write the value as in the scene file") from error
    places = {place: at for place, at in document.places.items() if place[: len(path)] != path}
    places[path] = f"--set {override}"
    return replace(document, data=put(document.data, path, value), places=places)


def _dangling_materials(data: dict[str, Any]) -> list[Problem]:
    """Objects whose material does not exist. Looks at plain data, so that it works beside other errors."""
    materials, objects = data.get("materials"), data.get("objects")
    if not isinstance(materials, dict) or not isinstance(objects, dict):
        return []
    problems = []
    for name, part in objects.items():
        material = part.get("material") if isinstance(part, dict) else None
        if isinstance(material, str) and material not in materials:
            message = f"no such material{suggestion(material, materials)}"
            problems.append(Problem(("objects", name, "material"), message, material))
    return problems
