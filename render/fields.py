"""What scene files are made of: parts, and the types of their values, each with its own words for errors."""

import math
import os
from pathlib import Path
from typing import Annotated, Any

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    StrictBool,
    ValidationInfo,
    WithJsonSchema,
)
from pydantic.json_schema import SkipJsonSchema
from pydantic_core import PydanticCustomError

LARGEST = 1e30  # kernels compute in single precision


class Part(BaseModel):
    """Common to all parts of a scene: unknown keys are errors, and nothing changes after validation."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)


def wrong(message: str) -> PydanticCustomError:
    """An error to raise in a validator."""
    return PydanticCustomError("scene", "{message}", {"message": message})


def _number(value: Any) -> float:
    if isinstance(value, dict) and "texture" in value:
        raise wrong("textures are not supported in this version; give the value itself")
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


def _not_yet(value: Any) -> Any:
    raise wrong("not supported in this version")


def supported_only(*later: str) -> BeforeValidator:
    """Refuse values that the scene file will take in a later version."""

    def check(value: Any) -> Any:
        return _not_yet(value) if value in later else value

    return BeforeValidator(check)


def _zero(value: float) -> float:
    return _not_yet(value) if value > 0 else value


_TRIPLE = {"type": "array", "items": {"type": "number"}, "minItems": 3, "maxItems": 3}
_COLOUR = {"type": "array", "items": {"type": "number", "minimum": 0}, "minItems": 3, "maxItems": 3}

NUMBER = BeforeValidator(_number)
WHOLE = BeforeValidator(_whole)

Number = Annotated[float, NUMBER]
Positive = Annotated[float, Field(gt=0), NUMBER]
NotNegative = Annotated[float, Field(ge=0), NUMBER]
Threshold = Annotated[float, Field(ge=0), NUMBER, AfterValidator(_zero)]
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
NotYet = SkipJsonSchema[Annotated[None, BeforeValidator(_not_yet)]]
