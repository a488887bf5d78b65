"""What is done of a long integration, kept in a file so that an interrupted run goes on where it was."""

import time
import zipfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from coslobe.core.files import atomic_path

INTERVAL = 10.0
"""Seconds between two writes: what a killed run loses."""

SHARE = 20.0
"""Times the duration of a write, at least: huge images are written less often."""


class Checkpoint:
    """Sums of named passes over blocks, in a file while a run lasts.

    Parameters
    ----------
    path : Path or None
        The file; without it, nothing is kept. One of other `settings`, or a broken one, is replaced.
    settings : str
        Hash of everything that the sums depend on.
    """

    def __init__(self, path: Path | None, settings: str = "") -> None:
        self._path = path
        self._arrays = {} if path is None else _read(path, settings)
        self._arrays["settings"] = np.array(settings)
        self._next = time.monotonic() + INTERVAL

    def restore(self, name: str, sums: Mapping[str, NDArray]) -> int:
        """Fill `sums` with what the pass `name` had reached; returns the number of blocks done."""
        if f"{name}/done" not in self._arrays:
            return 0
        for part, values in sums.items():
            values[...] = self._arrays[f"{name}/{part}"]
        return int(self._arrays[f"{name}/done"])

    def keep(self, name: str, sums: Mapping[str, NDArray], done: int, *, last: bool) -> None:
        """Note that `done` blocks are in `sums`; written from time to time, kept in memory when `last`."""
        start = time.monotonic()
        due = start > self._next
        if self._path is None or not (due or last):
            return
        self._arrays |= {f"{name}/{part}": values for part, values in sums.items()}
        self._arrays[f"{name}/done"] = np.array(done)
        if due:
            with atomic_path(self._path) as temporary:
                np.savez(temporary, **self._arrays)  # pyright: ignore[reportArgumentType]  # names of arrays
            end = time.monotonic()
            self._next = end + max(INTERVAL, SHARE * (end - start))

    def remove(self) -> None:
        """Everything is done: the file is not needed any more."""
        if self._path is not None:
            self._path.unlink(missing_ok=True)


NO_CHECKPOINT = Checkpoint(None)


def _read(path: Path, settings: str) -> dict[str, NDArray]:
    """The arrays of a checkpoint; nothing where there is none of these settings."""
    try:
        with np.load(path) as file:
            arrays = dict(file)
    except (OSError, EOFError, ValueError, KeyError, zipfile.BadZipFile):
        return {}
    return arrays if str(arrays.get("settings")) == settings else {}
