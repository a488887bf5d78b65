"""What every command shares: exit statuses, messages, one JSON document on stdout, signals."""

import json
import os
import signal
import subprocess
import sys
import warnings

import pytest
import typer
from typer.testing import CliRunner

from coslobe.cli import common
from coslobe.core import libraries
from coslobe.core.errors import CoslobeError, InvalidInput, NoDevice, UsageError

HINT = "do this [instead] as A:B:S"  # brackets and names in colons are markup to rich and must survive


def run(function, *arguments):
    """The result of a command made from `function`."""
    app = typer.Typer()
    app.command()(common.command(function))
    return CliRunner().invoke(app, list(arguments))


@pytest.mark.parametrize(
    ("error", "status"),
    [(CoslobeError, 1), (UsageError, 2), (InvalidInput, 3), (NoDevice, 4)],
)
def test_errors_have_their_statuses(error, status):
    def fail():
        raise error("scene.yaml:14:5: must be >= 0 [got -3]", HINT)

    result = run(fail)
    assert result.exit_code == status
    assert result.stdout == ""
    assert result.stderr == f"error: scene.yaml:14:5: must be >= 0 [got -3]\ntry: {HINT}\n"


def test_without_a_hint_there_is_one_line():
    def fail():
        raise CoslobeError("it failed")

    assert run(fail).stderr == "error: it failed\n"


def test_long_messages_stay_on_their_line():
    message = "a/very/long/path " * 40

    def fail():
        raise InvalidInput(message.strip())

    assert run(fail).stderr == f"error: {message.strip()}\n"


def test_debug_shows_the_traceback(monkeypatch):
    def fail():
        raise CoslobeError("it failed")

    monkeypatch.setenv("COSLOBE_DEBUG", "1")
    assert isinstance(run(fail).exception, CoslobeError)


@pytest.mark.parametrize(("raised", "status"), [(KeyboardInterrupt, 130), (common.Terminated, 143)])
def test_interruptions(raised, status):
    def stop():
        raise raised

    result = run(stop)
    assert result.exit_code == status
    assert "finished files are kept" in result.stderr


def test_out_of_memory():
    def fail():
        raise MemoryError

    result = run(fail)
    assert result.exit_code == 1
    assert result.stderr.startswith("error: out of memory\ntry: ")


@pytest.mark.parametrize("library", libraries.DEBIAN_PACKAGES)
def test_missing_system_libraries_are_named_with_their_packages(monkeypatch, library):
    def fail():
        raise ImportError(f"{library}: cannot open shared object file: No such file or directory")

    monkeypatch.setattr(libraries, "missing", lambda: [library, "libEGL.so.1"])
    result = run(fail)
    assert result.exit_code == 1
    first, second = result.stderr.splitlines()
    assert first.startswith(f"error: a system library is missing ({library}: ")
    packages = {libraries.DEBIAN_PACKAGES[library], "libegl1"}  # all at once, the loader stops at the first
    assert second == f"try: apt-get install {' '.join(sorted(packages))}"


def test_missing_python_package():
    def fail():
        import no_such_package_anywhere  # noqa: F401

    result = run(fail)
    assert result.exit_code == 1
    assert "no_such_package_anywhere" in result.stderr
    assert "Traceback" not in result.stderr


def noisy(json: common.JsonOption = False):
    print("noise")
    os.write(1, b"noise of a library written in C\n")
    warnings.warn("look here", stacklevel=1)
    with common.progress() as progress, progress.task("working", 3) as advance:
        advance(1, note="half")
        progress.say("something [worth] saying")
    if json:
        common.print_json({"value": 1})
    else:
        common.say("a [line] for people")


def test_json_is_alone_on_stdout():
    result = run(noisy, "--json")
    assert json.loads(result.stdout) == {"value": 1}
    assert "noise" in result.stderr


def test_progress_and_warnings_go_to_stderr():
    result = run(noisy)
    assert result.exit_code == 0
    assert result.stdout == "noise\na [line] for people\n"
    assert result.stderr == "warning: look here\nworking ...\nsomething [worth] saying\n"


@pytest.fixture
def script(tmp_path):
    """A program with one command, `--json` included, whose body is given."""

    def write(body):
        path = tmp_path / "program.py"
        path.write_text(
            "import os, sys, time, typer\n"
            "from pathlib import Path\n"
            "from coslobe.cli import common\n"
            "from coslobe.core.files import atomic_path\n"
            "app = typer.Typer()\n"
            "@app.command()\n"
            "@common.command\n"
            "def run(json: common.JsonOption = False):\n"
            + "".join(f"    {line}\n" for line in body.splitlines())
            + "app()\n"
        )
        return [sys.executable, str(path)]

    return write


def test_json_is_alone_on_the_real_stdout(script):
    command = script(
        "print('noise')\n"
        "os.write(1, b'noise of a library written in C\\n')\n"
        "common.print_json([1, 2])\n"
        "os.system('echo noise of a child')\n"
        "raise common.CoslobeError('failed after the document')"
    )
    done = subprocess.run([*command, "--json"], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert json.loads(done.stdout) == [1, 2]
    assert done.stderr.count("noise") == 3
    assert done.stderr.endswith("error: failed after the document\n")


@pytest.mark.parametrize(
    ("number", "status", "ignored"),
    [
        (signal.SIGTERM, 143, False),
        (signal.SIGINT, 130, False),
        (signal.SIGINT, 130, True),  # as in `coslobe render scene.yaml &` of a script
    ],
)
def test_signals_end_with_their_status_and_leave_no_half_files(script, tmp_path, number, status, ignored):
    command = script(
        "Path('finished').write_text('')\n"
        "with atomic_path(Path('frame.exr')) as temporary:\n"
        "    temporary.write_text('half')\n"
        "    print('ready', flush=True)\n"
        "    time.sleep(60)"
    )

    def ignore():
        signal.signal(signal.SIGINT, signal.SIG_IGN)

    child = subprocess.Popen(
        command,
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=ignore if ignored else None,
    )
    assert child.stdout is not None
    assert child.stdout.readline() == "ready\n"
    child.send_signal(number)
    _, stderr = child.communicate(timeout=30)
    assert child.returncode == status
    assert stderr.startswith("error: ")
    assert "Traceback" not in stderr
    assert sorted(path.name for path in tmp_path.iterdir()) == ["finished", "program.py"]


def test_bars_on_a_terminal_are_gone_at_the_end(script):
    import pty

    command = script(
        "with common.progress() as progress, progress.task('splatting', 4) as advance:\n"
        "    for _ in range(4):\n"
        "        advance(1)\n"
        "        time.sleep(0.15)\n"
        "print('done')"
    )
    try:
        parent, terminal = pty.openpty()
    except OSError as error:
        pytest.skip(f"no pseudo-terminals here: {error}")
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=terminal, text=True, check=False)
    os.close(terminal)
    shown = os.read(parent, 1 << 16).decode()
    os.close(parent)
    assert done.stdout == "done\n"
    assert "splatting" in shown
    assert "50 %" in shown
