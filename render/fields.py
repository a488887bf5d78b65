"""What scene files are made of: parts, and the types of their values, each with its own words for errors."""

import math
import os
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    StrictBool,
    ValidationInfo,
    WithJsonSchema,
)
from pydantic_core import PydanticCustomError

LARGEST = 1e30  # kernels compute in single precision


class Part(BaseModel):
    """Common to all parts of a scene: unknown keys are errors, and nothing changes after validation."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)


def wrong(message: str) -> PydanticCustomError:
    """An error to raise in a validator."""
    return PydanticCustomError("scene", "{message}", {"message": message})


def _number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise wrong("must be a number")
    if value != value or abs(value) == math.inf:
        raise wrong("must be finite")
    if abs(value) > LARGEST:
        raise wrong(f"must be within +-{LARGEST:g}")
    return float(value)


def _whole(value: Any) -> int:
    if _number(value) != int(value):
        raise wrong("must be a whole number")
    return int(value)


def _vector(value: Any) -> tuple[float, ...]:
    if not isinstance(value, list | tuple) or len(value) != 3:
        raise wrong("must be three numbers [x, y, z]")
    return tuple(_number(component) for component in value)


def _colour(value: Any) -> tuple[float, ...]:
    if not isinstance(value, list | tuple):
        value = (value,) * 3
    if len(value) != 3:
        raise wrong("must be a number or three numbers [r, g, b]")
    colour = tuple(_number(component) for component in value)
    if min(colour) < 0:
        raise wrong("must be >= 0")
    return colour


def _name(value: Any) -> str:
    if not isinstance(value, str) or not value or any(sign in value for sign in ".=\n"):
        raise wrong("a name must be text without '.' and '=' (quote a number)")
    return value


def _file(value: Any, info: ValidationInfo) -> str:
    if not isinstance(value, str):
        raise wrong("must be the path of a file")
    path = Path((info.context or {}).get("folder", "."), value)
    try:
        found = path.is_file()
    except OSError:  # a name longer than the system takes
        found = False
    if not found:
        raise wrong(f"no such file: {path}")
    return os.path.abspath(path)


def _mesh(value: Any, info: ValidationInfo) -> str:
    if isinstance(value, str) and value.startswith("sample:"):
        if value != "sample:bunny":
            raise wrong("no such sample; did you mean sample:bunny?")
        return value
    return _file(value, info)


_TRIPLE = {"type": "array", "items": {"type": "number"}, "minItems": 3, "maxItems": 3}
_COLOUR = {"type": "array", "items": {"type": "number", "minimum": 0}, "minItems": 3, "maxItems": 3}

NUMBER = BeforeValidator(_number)
WHOLE = BeforeValidator(_whole)

Number = Annotated[float, NUMBER]
Positive = Annotated[float, Field(gt=0), NUMBER]
NotNegative = Annotated[float, Field(ge=0), NUMBER]
Whole = Annotated[int, WHOLE]
Count = Annotated[int, Field(ge=1), WHOLE]
Switch = StrictBool
Vector = Annotated[tuple[float, float, float], BeforeValidator(_vector), WithJsonSchema(_TRIPLE)]
Colour = Annotated[
    tuple[float, float, float],
    BeforeValidator(_colour),
    WithJsonSchema({"anyOf": [{"type": "number", "minimum": 0}, _COLOUR]}),
]
Name = Annotated[str, BeforeValidator(_name)]
File = Annotated[str, BeforeValidator(_file)]
MeshFile = Annotated[str, BeforeValidator(_mesh)]


class Source(NamedTuple):
    """A picture and how it is read."""

    file: str
    colour: bool


class Texture(Part):
    """A number from a picture: offset + scale * texel."""

    texture: File
    """PNG, JPEG or EXR; v up, wrapped, bilinear. A number is the first channel as stored."""
    scale: Number = 1.0
    """Times the texel."""
    offset: Number = 0.0
    """Added to it."""

    @property
    def source(self) -> Source:
        """What has to be looked up."""
        return Source(self.texture, colour=isinstance(self, ColourTexture))


class ColourTexture(Texture):
    """A colour from a picture: offset + scale * texel, which is decoded with the sRGB curve."""


def _varying(plain: Callable[[Any], Any], texture: type[Texture]) -> Callable[[Any, ValidationInfo], Any]:
    """Validates a value that may be constant or come from a texture."""

    def check(value: Any, info: ValidationInfo) -> Any:
        if isinstance(value, dict):
            return texture.model_validate(value, context=info.context)
        return plain(value)

    return check


def _not_negative(value: Any) -> float:
    if _number(value) < 0:
        raise wrong("must be >= 0")
    return float(value)


def _three(value: Any) -> Any:
    if not isinstance(value, list | tuple) or len(value) != 3:
        raise wrong("must be three numbers [x, y, z]")
    return value


# Of materials: constant, or varying over the surface.
VaryingColour = Annotated[Colour | ColourTexture, BeforeValidator(_varying(_colour, ColourTexture))]
VaryingNumber = Annotated[Number | Texture, BeforeValidator(_varying(_number, Texture))]
VaryingNotNegative = Annotated[NotNegative | Texture, BeforeValidator(_varying(_not_negative, Texture))]
VaryingVector = Annotated[tuple[VaryingNumber, VaryingNumber, VaryingNumber], BeforeValidator(_three)]
