"""On what a measurement was made: machine, versions, commit, date."""

import os
import platform
import subprocess
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from coslobe.core.device import cpu_count
from coslobe.core.version import VERSION, library_versions


def provenance() -> dict[str, Any]:
    """made, version, commit (None outside a checkout), processor, cpus, load_average and package versions."""
    return {
        "made": datetime.now(UTC).isoformat(timespec="seconds"),
        "version": VERSION,
        "commit": commit(),
        "processor": processor(),
        "cpus": cpu_count(),
        "load_average": os.getloadavg()[0],
        "versions": library_versions(),
    }


def commit() -> str | None:
    """Short hash of the checkout that this code lies in, with a mark where it has changes; None without."""
    here = Path(__file__).resolve().parent
    if not (here.parent / ".git").exists():
        return None
    command = ["git", "-C", str(here), "describe", "--always", "--dirty"]
    try:
        found = subprocess.run(command, capture_output=True, text=True, check=False)
    except OSError:
        return None
    return found.stdout.strip() or None


def processor() -> str:
    """Name of the CPU."""
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text().splitlines() if cpuinfo.exists() else []
    names = [line.split(":")[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor()
