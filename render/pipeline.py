"""Stages of work that overlap: what comes next is made ahead, what is done is finished behind, in order."""

from collections.abc import Callable, Generator, Iterable
from concurrent.futures import ThreadPoolExecutor
from queue import Queue
from threading import Thread
from types import TracebackType
from typing import Any, TypeVar

Item = TypeVar("Item")

WAITING = 2  # jobs that wait for the thread behind: bounds the memory of what they hold

_END: Any = object()


def ahead(items: Iterable[Item]) -> Generator[Item]:
    """`items`, of which the next is made on a thread of its own while the caller uses the last."""
    iterator = iter(items)
    with ThreadPoolExecutor(1, "ahead") as thread:
        following = thread.submit(next, iterator, _END)
        while (item := following.result()) is not _END:
            following = thread.submit(next, iterator, _END)
            yield item


class Behind:
    """Does jobs one after another on a thread of its own.

    After a job has failed no other is done; the next call raises its error. Used as a context, it waits for
    the jobs to be done; where the context is left by an exception, only for the one that is being done.
    """

    def __init__(self) -> None:
        self._jobs: Queue[Callable[[], Any] | None] = Queue(WAITING)
        self._error: BaseException | None = None
        self._stopped = False
        self._thread = Thread(target=self._work, name="behind", daemon=True)

    def put(self, job: Callable[[], Any]) -> None:
        """Have `job` done; waits where too many are waiting already."""
        self._raise()
        self._jobs.put(job)

    def _work(self) -> None:
        while (job := self._jobs.get()) is not None:
            if not self._stopped:
                try:
                    job()
                except BaseException as error:  # the other thread raises it
                    self._error, self._stopped = error, True
            del job  # and what it holds, before the next one comes

    def _raise(self) -> None:
        if self._error is not None:
            error, self._error = self._error, None
            raise error

    def __enter__(self) -> "Behind":
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stopped |= kind is not None
        self._jobs.put(None)
        self._thread.join()
        if kind is None:
            self._raise()
