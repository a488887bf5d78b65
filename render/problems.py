"""What is wrong with a scene file, in words: each problem with its place, key and value."""

import json
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

from pydantic import BaseModel, ValidationError

from coslobe.core.errors import InvalidInput
from coslobe.render.scenepaths import keys_of, model_at, suggestion
from coslobe.render.yamlfile import Document, KeyPath, printable

_NOTHING = object()

_WORDS = {
    "missing": "required, but missing",
    "greater_than": "must be > {gt:g}",
    "greater_than_equal": "must be >= {ge:g}",
    "less_than": "must be < {lt:g}",
    "less_than_equal": "must be <= {le:g}",
    "literal_error": "must be {expected}",
    "bool_type": "must be true or false",
    "string_type": "must be text",
    "model_type": "must be a mapping of keys to values",
    "dict_type": "must be a mapping of keys to values",
    "tuple_type": "must be a list",
    "too_short": "must not be empty",
}


@dataclass(frozen=True)
class Problem:
    """One error: the key path, what is wrong, and the value that is wrong."""

    path: KeyPath
    message: str
    value: Any = _NOTHING

    def at_frame(self, frame: int) -> "Problem":
        """The same problem, said of the animated scene."""
        return replace(self, message=f"{self.message}, at frame {frame}")

    def text(self) -> str:
        """ "key.path: message (got value)"."""
        key = ".".join(map(str, self.path))
        got = "" if self.value is _NOTHING or isinstance(self.value, dict) else f" (got {_short(self.value)})"
        return printable(f"{key}: {self.message}{got}" if key else f"{self.message}{got}")


def problems_of(error: ValidationError, model: type[BaseModel] | None, data: Any) -> list[Problem]:
    """The problems that pydantic found in `data`, which was validated as a `model`."""
    problems = []
    for detail in error.errors(include_url=False):
        path = tuple(part for part in detail["loc"] if part != "[key]")
        kind = detail["type"]
        if kind == "default_factory_not_called":  # follows from another error in the same part
            continue
        if kind == "extra_forbidden":
            parent = model_at(model, path[:-1]) if model else None
            known = keys_of(parent) if parent else []
            problems.append(Problem(path, f"unknown key{suggestion(str(path[-1]), known)}"))
            continue
        message = _WORDS[kind].format(**detail.get("ctx", {})) if kind in _WORDS else detail["msg"]
        if kind == "missing":
            value = _NOTHING
        else:
            value = path[-1] if "[key]" in detail["loc"] else _written(data, path)
        problems.append(Problem(path, message, value))
    return problems


def _written(data: Any, path: KeyPath) -> Any:
    """The value at `path` as the file has it, before conversions."""
    for key in path:
        data = data[key]
    return data


def report(document: Document, problems: Iterable[Problem]) -> InvalidInput:
    """One error that lists all problems in the order of the file."""
    order = {path: position for position, path in enumerate(document.places)}
    ranked = sorted(problems, key=lambda problem: order[document.nearest(problem.path)])
    lines = dict.fromkeys(f"{document.place(problem.path)}: {problem.text()}" for problem in ranked)
    return InvalidInput("\n".join(lines), "coslobe schema and docs/scene_file.md describe the scene file")


def _short(value: Any) -> str:
    text = json.dumps(value, default=str, ensure_ascii=False)
    if isinstance(value, str):
        text = value
    return text if len(text) <= 60 else text[:57] + "..."
