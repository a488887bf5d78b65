"""Files appear whole or not at all: everything is written to a temporary name and renamed."""

import hashlib
import json
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from coslobe.core.errors import CoslobeError, InvalidInput

TEMPORARY_PREFIX = ".coslobe-tmp-"


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside `path` (same suffix); on success it is renamed, on failure removed.

    Raises
    ------
    CoslobeError
        The folder cannot be made or written.
    """
    path = Path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(prefix=TEMPORARY_PREFIX, suffix=path.suffix, dir=path.parent)
        os.close(handle)
        os.chmod(name, 0o666 & ~_umask())  # mkstemp makes files private; outputs are ordinary files
    except OSError as error:
        raise CoslobeError(
            f"{path}: cannot be written ({error.strerror or error})", "choose another folder"
        ) from error
    temporary = Path(name)
    try:
        yield temporary
        os.replace(temporary, path)
    except OSError as error:
        raise CoslobeError(
            f"{path}: cannot be written ({error.strerror or error})", "free space or choose another folder"
        ) from error
    finally:
        temporary.unlink(missing_ok=True)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def remove_leftovers(folder: Path) -> None:
    """Remove temporary files that a killed run left in `folder`."""
    for path in folder.glob(f"{TEMPORARY_PREFIX}*"):
        path.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Write UTF-8 text atomically."""
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_json(path: Path, document: Any) -> None:
    """Write `document` (plain data, NumPy scalars and arrays, paths) as JSON, atomically."""
    write_text(path, to_json(document) + "\n")


def to_json(document: Any) -> str:
    """JSON text of `document`; NumPy values become numbers and lists, paths absolute strings."""
    return json.dumps(document, indent=1, default=plain, allow_nan=False)


def plain(value: Any) -> Any:
    """NumPy values and paths as what JSON can hold; for `json.dumps(..., default=plain)`."""
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, Path):
        return str(value.absolute())
    raise TypeError(f"{type(value).__name__} has no JSON form")


def read_bytes(path: Path, what: str) -> bytes:
    """Contents of `path`; `what` names it in the error, as in "mesh file"."""
    try:
        return Path(path).read_bytes()
    except OSError as error:
        raise InvalidInput(f"{path}: {what} cannot be read ({error.strerror})", "check the path") from error


def sha256(path: Path) -> str:
    """Hexadecimal SHA-256 of a file, read in blocks.

    Raises
    ------
    InvalidInput
        The file cannot be read.
    """
    try:
        with open(path, "rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise InvalidInput(f"{path}: cannot be read ({error.strerror})", "check the path") from error
