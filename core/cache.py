"""The cache: files named by the hash of everything they depend on, so that they never go stale."""

import atexit
import hashlib
import json
import os
import shutil
import tempfile
import warnings
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import platformdirs

from coslobe.core.files import plain

_stand_ins: list[Path] = []  # temporary folders in place of some that cannot be written


def folder() -> Path:
    """The cache folder: `$COSLOBE_CACHE_DIR`, else `coslobe` in the user's cache; made if it is missing.

    Where neither can be written, a temporary folder stands in, with one warning.
    """
    chosen = os.environ.get("COSLOBE_CACHE_DIR")
    return _writable(chosen) if chosen else _writable(str(user_folder() / "coslobe"))


def lasting() -> bool:
    """Whether entries of the cache are still there in the next run."""
    return not any(folder().is_relative_to(path) for path in _stand_ins)


def user_folder() -> Path:
    """The user's cache folder, where PoCL, pyopencl and matplotlib keep caches of their own.

    PoCL finds no device and pyopencl fails where it cannot be written, so a temporary folder then stands in
    for all of them, with one warning.
    """
    wanted = platformdirs.user_cache_dir()
    path = _writable(wanted)
    if path != Path(wanted):
        os.environ["XDG_CACHE_HOME"] = str(path)
    return path


@lru_cache
def _writable(chosen: str) -> Path:
    path = Path(chosen)
    try:
        path.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path):
            pass
    except OSError as error:
        path = Path(tempfile.mkdtemp(prefix="coslobe-cache-"))
        _stand_ins.append(path)
        atexit.register(shutil.rmtree, path, ignore_errors=True)
        warnings.warn(
            f"cache folder {chosen} cannot be written ({error.strerror}): nothing will be kept for the next "
            "run. Set COSLOBE_CACHE_DIR and XDG_CACHE_HOME to folders that can be written.",
            stacklevel=2,
        )
    return path


def digest(*parts: Any) -> str:
    """Hexadecimal SHA-256 over the JSON form of `parts` (keys sorted): the identity of a cached result.

    Raises
    ------
    TypeError
        A part has no JSON form; its text could leave out what tells two results apart.
    """
    return hashlib.sha256(json.dumps(parts, sort_keys=True, default=plain).encode()).hexdigest()


@lru_cache(maxsize=8)
def code_digest(*rooms: str) -> str:
    """Hash of the source of `rooms` (as in "render.kernels"): what a change of the code makes out of date."""
    texts = []
    for room in rooms:
        code = [file for file in files(f"coslobe.{room}").iterdir() if file.name.endswith((".py", ".cl"))]
        texts += [file.read_text(encoding="utf-8") for file in sorted(code, key=lambda file: file.name)]
    return digest(texts)


def entry(kind: str, key: str, suffix: str) -> Path:
    """Path of the cache entry `key` of a `kind` (a sub-folder); the file may or may not exist."""
    path = folder() / kind
    path.mkdir(parents=True, exist_ok=True)
    return path / f"{key}{suffix}"
