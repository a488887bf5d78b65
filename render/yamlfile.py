"""YAML files as plain data in which every value still knows its line and column."""

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from coslobe.core.errors import InvalidInput
from coslobe.core.files import read_bytes

KeyPath = tuple[str | int, ...]

# Aliases repeat what they name: a few nested ones would otherwise fill the memory.
MAX_VALUES = 200_000

_CORE = "tag:yaml.org,2002:"


@dataclass
class Document:
    """Plain data (dict, list, str, int, float, bool, None) and where each part of it was written.

    Attributes
    ----------
    name : str
        The file's name as given, for messages.
    data : Any
    places : dict
        "file:line:column" of the key (in a list: of the item) per key path, in the file's order; the root
        has the path ().
    sha256 : str
        Of the text.
    """

    name: str
    data: Any
    places: dict[KeyPath, str]
    sha256: str

    def nearest(self, path: KeyPath) -> KeyPath:
        """`path` itself where it was written, else the nearest part around it that was."""
        while path and path not in self.places:
            path = path[:-1]
        return path

    def place(self, path: KeyPath) -> str:
        """Where `path` was written; for what the file leaves out, the nearest part around it."""
        return self.places[self.nearest(path)]


def read_yaml(path: str | Path) -> Document:
    """Read one YAML 1.2 document; tags that would build anything but plain data are refused.

    Raises
    ------
    InvalidInput
        The file cannot be read, is not YAML, repeats a key, refers to itself, or is too large.
    """
    raw = read_bytes(Path(path), "scene file")
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        raise InvalidInput(f"{path}:{line}:1: not UTF-8 text", "save the file as UTF-8") from error
    return parse_yaml(text, str(path))


def parse_yaml(text: str, name: str) -> Document:
    """Parse YAML text; `name` stands before line and column in messages. Errors as in `read_yaml`."""
    from ruamel.yaml import YAML
    from ruamel.yaml.error import MarkedYAMLError, YAMLError

    yaml = YAML(typ="safe", pure=True)
    reader = _Reader(name, yaml.constructor)
    try:
        root = yaml.compose(text)
        data = None if root is None else reader.value(root, ())
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        what = " ".join(part for part in (error.context, error.problem) if part)
        raise InvalidInput(f"{_place(name, mark)}: not valid YAML: {what}") from error
    except YAMLError as error:
        raise InvalidInput(f"{name}:1:1: not valid YAML: {' '.join(str(error).split())}") from error
    except RecursionError as error:
        raise InvalidInput(f"{name}:1:1: nested too deeply") from error
    digest = hashlib.sha256(text.encode()).hexdigest()
    return Document(name, data, {**reader.places, (): f"{name}:1:1"}, digest)


class _Reader:
    """Turns composed nodes into plain data, keeping places."""

    def __init__(self, name: str, constructor: Any) -> None:
        self.places: dict[KeyPath, str] = {}
        self._name = name
        self._scalars = {
            _CORE + "int": constructor.construct_yaml_int,
            _CORE + "float": constructor.construct_yaml_float,
            _CORE + "bool": constructor.construct_yaml_bool,
            _CORE + "null": lambda node: None,
            _CORE + "str": _text,
            _CORE + "timestamp": _text,  # looks like a date, means the text
        }
        self._open: set[int] = set()  # the nodes being read, to notice one inside itself
        self._count = 0

    def value(self, node: Any, path: KeyPath) -> Any:
        """Plain data of `node`, which stands at `path`."""
        self.places.setdefault(path, _place(self._name, node.start_mark))
        self._count += 1
        if self._count > MAX_VALUES:
            raise self._error(node, f"more than {MAX_VALUES} values")
        if id(node) in self._open:
            raise self._error(node, "an alias inside what it names")
        self._open.add(id(node))
        try:
            if node.tag == _CORE + "map" and node.id == "mapping":
                return self._mapping(node, path)
            if node.tag == _CORE + "seq" and node.id == "sequence":
                return [self.value(item, (*path, index)) for index, item in enumerate(node.value)]
            return self._scalar(node)
        finally:
            self._open.discard(id(node))

    def _mapping(self, node: Any, path: KeyPath) -> dict[str | int, Any]:
        result: dict[str | int, Any] = {}
        for key_node, value_node in node.value:
            key = self._scalar(key_node)
            if isinstance(key, bool) or not isinstance(key, str | int):
                raise self._error(key_node, f"a key must be text or a whole number (got {key_node.value})")
            if key in result:
                raise self._error(
                    key_node, f"{key}: the key stands twice, first at {self.places[*path, key]}"
                )
            self.places[*path, key] = _place(self._name, key_node.start_mark)
            result[key] = self.value(value_node, (*path, key))
        return result

    def _scalar(self, node: Any) -> Any:
        if node.tag not in self._scalars or node.id != "scalar":
            if node.tag in (_CORE + "map", _CORE + "seq"):
                raise self._error(node, f"a {node.id} cannot stand here")
            raise self._error(node, f"{node.tag.replace(_CORE, '!!')}: only plain data may stand here")
        try:
            return self._scalars[node.tag](node)
        except (ValueError, LookupError, OverflowError) as error:
            raise self._error(node, f"not a value of its type (got {node.value[:60]})") from error

    def _error(self, node: Any, message: str) -> InvalidInput:
        return InvalidInput(f"{_place(self._name, node.start_mark)}: {printable(message)}")


def printable(text: str) -> str:
    """`text` with line breaks and control characters escaped, for one line of a message."""
    return "".join(
        sign if sign.isprintable() else sign.encode("unicode_escape").decode("ascii") for sign in text
    )


def _text(node: Any) -> str:
    """The node's text; JSON's escaped surrogate pairs become the characters that they stand for."""
    return node.value.encode("utf-16", "surrogatepass").decode("utf-16")


def _place(name: str, mark: Any) -> str:
    return name if mark is None else f"{name}:{mark.line + 1}:{mark.column + 1}"
