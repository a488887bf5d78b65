"""The cache: files named by the hash of everything they depend on, so that they never go stale."""

import hashlib
import json
import os
import tempfile
import warnings
from functools import lru_cache
from pathlib import Path
from typing import Any

import platformdirs


def folder() -> Path:
    """The cache folder: `$COSLOBE_CACHE_DIR`, else the platform's user cache; made if it is missing.

    Where neither can be written, a temporary folder stands in, with one warning.
    """
    chosen = os.environ.get("COSLOBE_CACHE_DIR") or platformdirs.user_cache_dir("coslobe", appauthor=False)
    return _writable(chosen)


@lru_cache(maxsize=4)
def _writable(chosen: str) -> Path:
    path = Path(chosen)
    try:
        path.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path):
            pass
    except OSError as error:
        path = Path(tempfile.mkdtemp(prefix="coslobe-cache-"))
        warnings.warn(
            f"cache folder {chosen} cannot be written ({error.strerror}); using {path} for now. "
            "Set COSLOBE_CACHE_DIR to a writable folder to keep results.",
            stacklevel=2,
        )
    return path


def digest(*parts: Any) -> str:
    """Hexadecimal SHA-256 over the JSON form of `parts` (keys sorted): the identity of a cached result."""
    return hashlib.sha256(json.dumps(parts, sort_keys=True, default=str).encode()).hexdigest()


def entry(kind: str, key: str, suffix: str) -> Path:
    """Path of the cache entry `key` of a `kind` (a sub-folder); the file may or may not exist."""
    path = folder() / kind
    path.mkdir(parents=True, exist_ok=True)
    return path / f"{key}{suffix}"
