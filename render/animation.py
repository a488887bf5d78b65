"""Keyframes: the value of a number, vector or switch at a frame, and scene data with such values put in."""

from bisect import bisect_right
from collections.abc import Iterable
from dataclasses import dataclass
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel, Field, TypeAdapter, ValidationError

from coslobe.render.fields import Part, Whole
from coslobe.render.problems import Problem, problems_of
from coslobe.render.scenepaths import UnknownPath, follow
from coslobe.render.yamlfile import KeyPath

Value = float | int | bool | tuple[float, ...]

_ANIMATABLE = (float, int, bool, tuple[float, float, float])

# What must be the same in all frames.
_FIXED = ("coslobe", "sequence", "animation", "image.width", "image.height")


class Animation(Part):
    """Keyframes of one value of the scene."""

    target: str
    """Path of a number, colour, vector or `visible`, as in objects.bunny.transform.rotate_y."""
    keys: Annotated[dict[Whole, Any], Field(min_length=1)]
    """Frame: value. Held constant before the first frame and after the last."""
    interpolation: Literal["linear", "step", "smooth"] = "linear"
    """Between the keys; whole numbers and `visible` always step."""


@dataclass(frozen=True)
class Track:
    """The animation of one value.

    Attributes
    ----------
    path : tuple
        Where the value stands in the scene's data.
    frames : tuple of int
        Increasing, at least one.
    values : tuple
        One per frame, all of one shape: numbers, vectors, whole numbers or switches.
    interpolation : str
        "linear", "step" (the last key's value), or "smooth" (3 t^2 - 2 t^3 between keys: no velocity at
        a key). Whole numbers and switches always step.
    """

    path: KeyPath
    frames: tuple[int, ...]
    values: tuple[Value, ...]
    interpolation: str

    def at(self, frame: int) -> Value:
        """The value at `frame`; held constant before the first key and after the last."""
        last = bisect_right(self.frames, frame) - 1
        if last < 0:
            return self.values[0]
        before = self.values[last]
        if last + 1 == len(self.frames) or self.interpolation == "step" or isinstance(before, int):
            return before
        after = self.values[last + 1]
        t = (frame - self.frames[last]) / (self.frames[last + 1] - self.frames[last])
        if self.interpolation == "smooth":
            t = t * t * (3 - 2 * t)
        if isinstance(before, tuple) and isinstance(after, tuple):
            return tuple(_between(a, b, t) for a, b in zip(before, after, strict=True))
        assert isinstance(before, float)
        assert isinstance(after, float)
        return _between(before, after, t)


def _between(a: float, b: float, t: float) -> float:
    """(1 - t) a + t b, kept within a and b against rounding, so that a constant stays exactly constant."""
    low, high = min(a, b), max(a, b)
    return min(max((1 - t) * a + t * b, low), high)


def animated(data: Any, tracks: Iterable[Track], frame: int) -> Any:
    """Scene data with every animated value put in; what does not change is shared with `data`."""
    for track in tracks:
        data = put(data, track.path, track.at(frame))
    return data


def put(data: Any, path: KeyPath, value: Any) -> Any:
    """A copy of `data` with `value` at `path`; mappings that are missing on the way are made."""
    if not path:
        return value
    key, rest = path[0], path[1:]
    if isinstance(data, list | tuple):
        items = list(data)
        items[int(key)] = put(items[int(key)], rest, value)
        return items
    result = dict(data or {})
    result[key] = put(result.get(key), rest, value)
    return result


def read_tracks(data: dict[str, Any], model: type[BaseModel]) -> tuple[tuple[Track, ...], list[Problem]]:
    """The tracks of a scene file's `animation`, and what is wrong with their targets and key values.

    `model` describes the whole file. Entries that are malformed in themselves are left out silently: they
    are reported when the file is validated.
    """
    entries = data.get("animation")
    tracks: list[Track] = []
    problems: list[Problem] = []
    for index, entry in enumerate(entries if isinstance(entries, list) else ()):
        try:
            animation = Animation.model_validate(entry)
        except ValidationError:
            continue
        place: KeyPath = ("animation", index)
        try:
            path, kind = _animatable(data, model, animation.target)
            if any(_overlap(track.path, path) for track in tracks):
                raise UnknownPath("animated twice")
        except UnknownPath as error:
            problems.append(Problem((*place, "target"), str(error), animation.target))
            continue
        frames = tuple(sorted(animation.keys))
        values, wrong_values = _key_values(kind, animation, (*place, "keys"))
        problems += wrong_values
        if not wrong_values:
            tracks.append(
                Track(path, frames, tuple(values[frame] for frame in frames), animation.interpolation)
            )
    return tuple(tracks), problems


def _animatable(data: dict[str, Any], model: type[BaseModel], target: str) -> tuple[KeyPath, Any]:
    path, kind = follow(model, data, target)
    if any(target == fixed or target.startswith(f"{fixed}.") for fixed in _FIXED):
        raise UnknownPath("must be the same in all frames")
    for choice in _choices(kind):
        if _plain(choice) in _ANIMATABLE:
            return path, choice
    raise UnknownPath("only numbers, colours, vectors and visible can be animated")


def _choices(kind: Any) -> tuple[Any, ...]:
    """The members of a union, or the type itself."""
    return get_args(kind) if get_origin(kind) in (Union, UnionType) else (kind,)


def _plain(kind: Any) -> Any:
    """The type of a constant value: without annotations, and the number where a texture may stand too."""
    if get_origin(kind) in (Annotated, Union, UnionType):
        return _plain(get_args(kind)[0])
    if get_origin(kind) is tuple:
        return tuple[tuple(_plain(item) for item in get_args(kind))]
    return kind


def _overlap(a: KeyPath, b: KeyPath) -> bool:
    shorter = min(len(a), len(b))
    return a[:shorter] == b[:shorter]


def _key_values(kind: Any, animation: Animation, place: KeyPath) -> tuple[dict[int, Any], list[Problem]]:
    """Values by frame, each validated as the value that it stands for."""
    adapter = TypeAdapter(kind)
    values: dict[int, Any] = {}
    problems: list[Problem] = []
    for frame, value in animation.keys.items():
        if any(isinstance(part, dict) for part in (value if isinstance(value, list) else [value])):
            message = "must be a number; of a texture, scale and offset can be animated"
            problems.append(Problem((*place, frame), message, value))
            continue
        try:
            values[frame] = adapter.validate_python(value)
        except ValidationError as error:
            for problem in problems_of(error, None, value):
                problems.append(Problem((*place, frame), problem.message, value))
    return values, problems
