"""What every command shares: error handling with exit statuses, progress on stderr, JSON on stdout."""

import functools
import os
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout
from typing import Annotated, Any, NoReturn, TextIO

import typer
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.progress import Progress as Bars

from coslobe.core import libraries
from coslobe.core.errors import CoslobeError
from coslobe.core.files import to_json
from coslobe.core.progress import Progress

INTERRUPTED = 130
TERMINATED = 143

JsonOption = Annotated[bool, typer.Option("--json", help="Print exactly one JSON document on stdout.")]
DeviceOption = Annotated[
    str | None,
    typer.Option(help="Index of `coslobe devices`, or a part of its platform, version and name."),
]


class Terminated(BaseException):
    """SIGTERM arrived; raised in the main thread so that files in progress are cleaned up."""


def command(function: Callable[..., None]) -> Callable[..., None]:
    """Wrap a command: known failures become one message on stderr and their exit status.

    With `--json`, stdout is kept for the document: whatever else is printed goes to stderr.
    """

    @functools.wraps(function)
    def guarded(*args: Any, **kwargs: Any) -> None:
        if threading.current_thread() is threading.main_thread():
            _listen()
        try:
            with warnings.catch_warnings(), _stdout_kept_for_json(kwargs.get("json", False)):
                warnings.showwarning = _show_warning
                try:
                    function(*args, **kwargs)
                except Exception:
                    _raise_if_stopped()  # the failure is what some library made of the signal
                    raise
        except CoslobeError as error:
            if os.environ.get("COSLOBE_DEBUG"):
                raise
            fail(str(error), error.hint, error.exit_status)
        except ImportError as error:
            if os.environ.get("COSLOBE_DEBUG"):
                raise
            fail(*_missing_library(error), 1)
        except OSError as error:  # what no room foresaw, such as a full disk behind stdout
            if os.environ.get("COSLOBE_DEBUG"):
                raise
            name = f"{error.filename}: " if error.filename else ""
            fail(f"{name}{error.strerror or error}", "check free space and permissions", 1)
        except KeyboardInterrupt:
            fail("interrupted; finished files are kept", None, INTERRUPTED)
        except Terminated:
            fail("terminated; finished files are kept", None, TERMINATED)
        except MemoryError:
            fail("out of memory", "use a smaller image, fewer samples or a simpler mesh", 1)

    return guarded


# The signal that arrived. Its exception may get lost: some libraries (trimesh) swallow what is raised while
# they are imported, and so does Python in destructors. The next report of progress raises it again.
_arrived: int | None = None


def _listen() -> None:
    """Turn SIGINT (which a shell's background job ignores) and SIGTERM into exceptions."""
    global _arrived
    _arrived = None
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _stop)


def _stop(number: int, _: Any) -> None:
    global _arrived
    _arrived = number
    _raise_if_stopped()


def _raise_if_stopped() -> None:
    if _arrived is not None:
        raise KeyboardInterrupt if _arrived == signal.SIGINT else Terminated


def fail(message: str, hint: str | None, status: int) -> NoReturn:
    """Print an error and end with `status`."""
    console = _stderr()
    console.print(f"[bold red]error:[/] {escape(message)}", soft_wrap=True)
    if hint:
        console.print(f"[bold]try:[/] {escape(hint)}", soft_wrap=True)
    raise typer.Exit(status)


def _missing_library(error: ImportError) -> tuple[str, str]:
    """Message and remedy for a package that cannot be imported, most often for want of a system library."""
    known = {name for name in libraries.DEBIAN_PACKAGES if name in str(error)}
    if known:  # name all at once: the loader stops at the first
        packages = sorted(libraries.DEBIAN_PACKAGES[name] for name in known | set(libraries.missing()))
        return f"a system library is missing ({error})", f"apt-get install {' '.join(packages)}"
    return f"a Python package cannot be loaded ({error})", "pip install --force-reinstall coslobe"


def _show_warning(message: Warning | str, *_: Any, **__: Any) -> None:
    _stderr().print(f"[bold yellow]warning:[/] {escape(str(message))}", soft_wrap=True)


_json_output: TextIO | None = None  # the real stdout while it is kept for the document


@contextmanager
def _stdout_kept_for_json(wanted: bool) -> Iterator[None]:
    """Send to stderr what anybody but `print_json` writes to stdout, libraries written in C included."""
    global _json_output
    if not wanted:
        yield
        return
    try:
        descriptor = sys.stdout.fileno()
    except OSError:  # not a file, as in tests: there is only Python's own stream to redirect
        descriptor = None
    stdout = sys.stdout if descriptor is None else open(os.dup(descriptor), "w", encoding="utf-8")  # noqa: SIM115
    _json_output = stdout
    try:
        if descriptor is not None:
            sys.stdout.flush()
            os.dup2(2, descriptor)
        with redirect_stdout(sys.stderr):
            yield
    finally:
        _json_output = None
        stdout.flush()
        if descriptor is not None:
            os.dup2(stdout.fileno(), descriptor)
            stdout.close()


def print_json(document: Any) -> None:
    """The one JSON document of a command with --json."""
    (_json_output or sys.stdout).write(to_json(document) + "\n")


def say(text: str) -> None:
    """One line for a person, on stdout."""
    Console(highlight=False, soft_wrap=True, emoji=False).print(escape(text))


def _stderr() -> Console:
    return Console(stderr=True, highlight=False, emoji=False)  # "A:B:S" must not become a picture


class _Terminal(Progress):
    """Progress bars on a terminal, plain lines elsewhere; always on stderr."""

    def __init__(self, bars: Bars | None, console: Console) -> None:
        self._bars = bars
        self._console = console

    def say(self, text: str) -> None:
        _raise_if_stopped()
        self._console.print(escape(text), soft_wrap=True)

    @contextmanager
    def task(self, name: str, total: float) -> Iterator[Callable[..., None]]:
        _raise_if_stopped()
        bars = self._bars
        if bars is None:
            self._console.print(escape(f"{name} ..."), soft_wrap=True)
            yield lambda amount=1.0, note="": _raise_if_stopped()
            return
        task = bars.add_task(name, total=total, note="")

        def advance(amount: float = 1.0, note: str = "") -> None:
            _raise_if_stopped()
            bars.update(task, advance=amount, note=note)

        try:
            yield advance
        finally:
            bars.remove_task(task)


@contextmanager
def progress() -> Iterator[Progress]:
    """The listener that long work reports to while a command runs."""
    console = _stderr()
    if not console.is_terminal:
        yield _Terminal(None, console)
        return
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[note]}"),
    )
    with Bars(*columns, console=console, transient=True) as bars:
        yield _Terminal(bars, console)
