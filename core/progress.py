"""How long work reports on itself, without knowing who listens: the command line, a test, or nobody."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager


class Progress:
    """The silent listener; the command line overrides both methods."""

    def say(self, text: str) -> None:
        """One line about what is being done or why."""

    @contextmanager
    def task(self, name: str, total: float) -> Iterator[Callable[..., None]]:
        """A piece of work of `total` units; yields `advance(amount=1, note="")`."""
        yield lambda amount=1.0, note="": None


SILENT = Progress()
