"""Dotted paths into a scene file, as `--set` and animation targets write them, checked against the models."""

from collections.abc import Iterable
from difflib import get_close_matches
from types import NoneType, UnionType
from typing import Annotated, Any, Union, get_args, get_origin

from pydantic import BaseModel

from coslobe.render.yamlfile import KeyPath


class UnknownPath(LookupError):
    """A path that leads nowhere; the message says from where on, and what may have been meant."""


def follow(model: type[BaseModel], data: Any, dotted: str) -> tuple[KeyPath, Any]:
    """The key path that `dotted` writes, and the type of the value there.

    Keys of models may be absent from `data` (they are optional), names of materials, lights and objects and
    positions in lists may not.

    Raises
    ------
    UnknownPath
    """
    path: KeyPath = ()
    kind: Any = model
    for part in dotted.split("."):
        key, kind = _step(kind, data, part, ".".join(map(str, path)))
        data = _item(data, key)
        path = (*path, key)
    return path, kind


def suggestion(word: str, known: Iterable[Any]) -> str:
    """ "; did you mean 'x'?" for the nearest of the `known` words, else the list of them."""
    words = [str(item) for item in known]
    if near := get_close_matches(word, words, n=1, cutoff=0.6):
        return f"; did you mean {near[0]}?"
    return f"; known: {', '.join(words)}" if 0 < len(words) <= 12 else ""


def keys_of(model: type[BaseModel]) -> list[str]:
    """The keys of a model that this version supports."""
    return [name for name, field in model.model_fields.items() if _bare(field.annotation) is not NoneType]


def model_at(model: type[BaseModel], path: KeyPath) -> type[BaseModel] | None:
    """The model that stands at `path`, if one does."""
    kind: Any = model
    for key in path:
        kind = _bare(kind, mapping=isinstance(key, str))
        if _is_model(kind):
            field = kind.model_fields.get(key)
            kind = field.annotation if field else None
        else:
            arguments = get_args(kind)
            kind = arguments[1 if get_origin(kind) is dict else 0] if arguments else None
    kind = _bare(kind, mapping=True)
    return kind if _is_model(kind) else None


def _step(kind: Any, data: Any, part: str, parent: str) -> tuple[str | int, Any]:
    """The key that `part` writes in a value of type `kind`, and the type of what stands there."""
    kind = _bare(kind, mapping=isinstance(data, dict))
    within = f" in {parent}" if parent else ""
    if _is_model(kind):
        if data is not None and not isinstance(data, dict):
            raise UnknownPath(f"{parent} is not a mapping")
        field = kind.model_fields.get(part)
        if field is None:
            raise UnknownPath(f"no {part!r}{within}{suggestion(part, keys_of(kind))}")
        return part, Annotated[field.annotation, *field.metadata] if field.metadata else field.annotation
    if get_origin(kind) is dict and isinstance(data, dict):
        key = next((key for key in data if str(key) == part), None)
        if key is None:
            raise UnknownPath(f"no {part!r}{within}{suggestion(part, data)}")
        return key, get_args(kind)[1]
    if get_origin(kind) in (list, tuple) and isinstance(data, list | tuple):
        if not part.isdecimal() or int(part) >= len(data):
            raise UnknownPath(f"no {part!r}{within}; it holds {len(data)} items, counted from 0")
        return int(part), get_args(kind)[0]
    raise UnknownPath(f"no {part!r}{within}")


def _item(data: Any, key: str | int) -> Any:
    if isinstance(data, dict):
        return data.get(key)
    return data[key] if isinstance(data, list | tuple) and isinstance(key, int) else None


def _bare(kind: Any, *, mapping: bool = False) -> Any:
    """The type without annotations; of a union the first member, or the model for a `mapping`."""
    if get_origin(kind) is Annotated:
        return _bare(get_args(kind)[0], mapping=mapping)
    if get_origin(kind) in (Union, UnionType):
        kinds = [_bare(part, mapping=mapping) for part in get_args(kind) if part is not NoneType]
        return next((part for part in kinds if mapping and _is_model(part)), kinds[0])
    return kind


def _is_model(kind: Any) -> bool:
    return isinstance(kind, type) and issubclass(kind, BaseModel)
