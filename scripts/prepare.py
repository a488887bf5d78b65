"""Set up a checkout, as far as that is not done yet; every make target runs `python3 scripts/prepare.py`.

1. System libraries and an OpenCL runtime for the CPU, through apt where that is allowed.
2. A virtual environment in .venv with the versions of constraints.txt and coslobe itself, editable.
3. A self-test of OpenCL; where nothing passes it, the PoCL wheel.

A stamp in .venv holds a hash of all that decides about its contents; while it fits, nothing is done.
With the argument "browser": Chromium for the tests of reports; with "llvm": what Mitsuba's fast variant needs
in benchmarks; both through apt where that is allowed.
Needs Python alone, and ends with status 1 and the next step where something cannot be done from here.
"""

from __future__ import annotations  # an older Python shall get as far as the message about its age

import hashlib
import importlib.util
import os
import runpy
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
VENV = ROOT / ".venv"
PYTHON = VENV / "bin" / "python"
STAMP = VENV / "coslobe.stamp"
RUNTIME = "pocl-opencl-icd"
BROWSER = "chromium"
LLVM = "libllvm19"


def main() -> None:
    if sys.version_info < (3, 11):  # noqa: UP036
        stop(f"Python 3.11 or newer is needed, and {sys.executable} is older", "make PYTHON=python3.12 test")
    state = fingerprint()
    if PYTHON.exists() and STAMP.exists() and STAMP.read_text() == state:
        return
    system_packages()
    python_packages()
    opencl()
    STAMP.write_text(state)


def fingerprint() -> str:
    """A hash of what the environment is made from, where it stands, and for which Python."""
    sources = [ROOT / "pyproject.toml", ROOT / "constraints.txt", Path(__file__)]
    text = [str(ROOT), sys.version, *(path.read_text() for path in sources)]
    return hashlib.sha256("\0".join(text).encode()).hexdigest()


def system_packages() -> None:
    libraries = runpy.run_path(str(ROOT / "core" / "libraries.py"))
    needed = [libraries["DEBIAN_PACKAGES"][name] for name in libraries["missing"]()]
    if importlib.util.find_spec("ensurepip") is None:  # Debian keeps it apart from Python
        needed.append(f"python3.{sys.version_info.minor}-venv")
    wished = [] if opencl_runtime_loads() else [RUNTIME]
    if not needed and not wished:
        return
    line = f"sudo apt-get update && sudo apt-get install -y {' '.join(needed + wished)}"
    apt_get = administrator_apt_get()
    if apt_get is None:
        if needed:
            stop(
                "system packages are missing and may not be installed from here. Run this, then make again:",
                line,
            )
        return
    say(f"system packages: {' '.join(needed + wished)}")
    run(*apt_get, "update", "-qq")  # may fail: the lists of another day may do as well
    install = [*apt_get, "install", "-y", "-qq", "--no-install-recommends"]
    if needed and not run(*install, *needed):
        stop("apt-get failed; first run", line)
    if wished and not run(*install, *wished):
        say(f"{RUNTIME} could not be installed; the PoCL wheel takes its place")


def optional(package: str, present: bool, without: str) -> None:
    """A system package that nothing fails without, where it is missing; `without` says what then happens."""
    if present:
        return
    apt_get = administrator_apt_get()
    if apt_get is None:
        say(f"{without}; to change that: sudo apt-get install -y {package}")
        return
    say(f"system packages: {package}")
    run(*apt_get, "update", "-qq")
    if not run(*apt_get, "install", "-y", "-qq", "--no-install-recommends", package):
        say(f"{package} could not be installed; {without}")


def browser() -> None:
    """Chromium, for the tests of reports."""
    optional(BROWSER, bool(shutil.which(BROWSER)), "tests of reports will be skipped")


def llvm() -> None:
    """A libLLVM that Mitsuba's vectorised variant works with: 15 ends the process."""
    found = any(Path("/usr/lib").glob("*/libLLVM*19*"))
    optional(LLVM, found, "Mitsuba will be timed in its scalar variant")


def opencl_runtime_loads() -> bool:
    """Whether an OpenCL runtime that is registered with the system can be loaded."""
    folder = Path(os.environ.get("OCL_ICD_VENDORS", "/etc/OpenCL/vendors"))
    names = [path.read_text().strip() for path in folder.glob("*.icd")]
    load = "import ctypes, sys; ctypes.CDLL(sys.argv[1])"  # in a child, which may crash or print
    return any(run(sys.executable, "-c", load, name, quiet=True) for name in names)


def administrator_apt_get() -> list[str] | None:
    """The apt-get command with the rights to install; None where there is none without a password."""
    if shutil.which("apt-get"):
        if os.geteuid() == 0:
            return ["env", "DEBIAN_FRONTEND=noninteractive", "apt-get"]
        if shutil.which("sudo") and run("sudo", "-n", "true", quiet=True):
            return ["sudo", "-n", "env", "DEBIAN_FRONTEND=noninteractive", "apt-get"]
    return None


def python_packages() -> None:
    version = sys.version_info[:2]
    if not run(PYTHON, "-c", f"import sys; sys.exit(sys.version_info[:2] != {version})", quiet=True):
        say("virtual environment .venv")
        must(sys.executable, "-m", "venv", "--clear", VENV)
    say("Python packages (the first time some 600 MB to load)")
    pip_install("setuptools")
    pip_install("--no-build-isolation", "--editable", ".[dev,mitsuba]")


def opencl() -> None:
    say("OpenCL self-test")
    command = [VENV / "bin" / "coslobe", "devices"]
    if not run(*command, quiet=True):
        pip_install("--no-build-isolation", "--editable", ".[cpu]")
        must(*command)


def pip_install(*arguments: str) -> None:
    quiet = [] if sys.stdout.isatty() else ["--quiet"]
    options = ["--disable-pip-version-check", "--constraint", "constraints.txt", *quiet]
    must(PYTHON, "-m", "pip", "install", *options, *arguments)


def run(*command: str | Path, quiet: bool = False) -> bool:
    """Run a command in the checkout; whether it succeeded."""
    sink = subprocess.DEVNULL if quiet else None
    try:
        return subprocess.run(command, cwd=ROOT, stdout=sink, stderr=sink, check=False).returncode == 0
    except OSError:
        return False


def must(*command: str | Path) -> None:
    if not run(*command):
        stop("this step failed:", " ".join(map(str, command)))


def say(text: str) -> None:
    print(f"== {text}", flush=True)


def stop(reason: str, line: str) -> None:
    print(f"set-up: {reason}\n    {line}", file=sys.stderr)
    sys.exit(1)


if __name__ == "__main__":
    {"browser": browser, "llvm": llvm}.get("".join(sys.argv[1:]), main)()
