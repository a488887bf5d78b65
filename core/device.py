"""OpenCL devices: which there are, which can be trusted, how programs are built and launched on one."""

import json
import os
import re
import subprocess
import sys
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from coslobe.core import cache
from coslobe.core.errors import CoslobeError, NoDevice, UsageError
from coslobe.core.files import write_json
from coslobe.core.version import VERSION

# Denormals are flushed because CPUs are slow on them; nothing that matters is that small. Relaxed maths
# stays off: it breaks the comparisons with infinity and the error bounds of exp and log.
BUILD_OPTIONS = ("-cl-std=CL1.2", "-cl-denorms-are-zero", "-cl-mad-enable")

INSTALL_HINT = (
    "install a runtime: `apt-get install pocl-opencl-icd` (Debian, Ubuntu; fastest on a CPU), or "
    "`pip install pocl-binary-distribution`, or the driver of your GPU"
)

PROBE_SECONDS = 30


@dataclass(frozen=True)
class DeviceInfo:
    """One OpenCL device and what the probe found.

    Attributes
    ----------
    index : int
        Position in `devices()`, the number that `--device` takes.
    platform, version, name : str
        Platform name, the runtime's version string, and the device name.
    kind : str
        "cpu", "gpu" or "other".
    vector_width : int
        Float lanes that kernels use on this device; 0 where it is not usable.
    ok : bool
    why : str
        Why the device is not usable, or what had to be avoided; empty where all is well.
    """

    index: int
    platform: str
    version: str
    name: str
    kind: str
    vector_width: int
    ok: bool
    why: str

    @property
    def title(self) -> str:
        """The text that `--device` is matched against."""
        return f"{self.platform} {self.version} {self.name}"


def devices(*, fresh: bool = False) -> list[DeviceInfo]:
    """Every OpenCL device with the widest vectors that it survives, found by a probe in a child process.

    A runtime that crashes while compiling takes only the child with it. Probe results are cached by
    runtime and device; `fresh` runs them again.
    """
    return [_probed(index, device, fresh=fresh) for index, device in enumerate(raw_devices())]


def select(wish: str | None = None) -> DeviceInfo:
    """The device that `wish` names: an index, or a part of "platform version device" (any case).

    Of several, and without a wish: a GPU before a CPU, and of several CPU runtimes the newest.

    Raises
    ------
    NoDevice
        There is no usable device, or what `wish` names is not usable.
    UsageError
        `wish` names no device.
    """
    candidates = sorted(enumerate(raw_devices()), key=_preference, reverse=True)
    if not candidates:
        raise NoDevice("no OpenCL device found", INSTALL_HINT)
    if wish is not None:
        candidates = [c for c in candidates if wish == str(c[0])] or [
            c for c in candidates if wish.lower() in _title(c[1]).lower()
        ]
        if not candidates:
            known = ", ".join(f"{index}: {_title(device)}" for index, device in enumerate(raw_devices()))
            raise UsageError(f"--device {wish}: no device has this index or name", f"one of: {known}")
    refused = []
    for index, device in candidates:  # in order of preference, so that only as many are probed as necessary
        info = _probed(index, device, fresh=False)
        if info.ok:
            return info
        refused.append(f"[{index}] {info.name}: {info.why}")
    raise NoDevice(
        f"no usable OpenCL device ({'; '.join(refused)})",
        f"`coslobe devices` to test again, or {INSTALL_HINT}",
    )


def _preference(candidate: tuple[int, Any]) -> tuple[bool, tuple[int, ...], int]:
    index, device = candidate
    return (_kind(device) == "gpu", _release(device.platform.version), -index)


def _release(version: str) -> tuple[int, ...]:
    """Version numbers after the leading "OpenCL x.y": "OpenCL 3.0 PoCL 3.1+debian" -> (3, 1)."""
    numbers = re.findall(r"\d+(?:\.\d+)+", version.split("LLVM")[0])
    return tuple(int(part) for part in numbers[-1].split(".")) if numbers else ()


def _names(device: Any) -> dict[str, str]:
    return {
        "platform": device.platform.name.strip(),
        "version": device.platform.version.strip(),
        "name": device.name.strip(),
    }


def _title(device: Any) -> str:
    """As `DeviceInfo.title`, before anything is known about the device."""
    return " ".join(_names(device).values())


@lru_cache(maxsize=1)
def raw_devices() -> tuple[Any, ...]:
    """pyopencl's devices of all platforms, in the order of their indices."""
    cache.user_folder()  # before PoCL looks for it
    cl = _pyopencl()
    try:
        platforms = cl.get_platforms()
    except cl.Error:  # the loader reports "no platform" as an error
        return ()
    found = []
    for platform in platforms:
        try:
            found += platform.get_devices()
        except cl.Error:  # a platform without devices
            continue
    return tuple(found)


def _pyopencl() -> Any:
    try:
        import pyopencl
    except ImportError as error:
        raise NoDevice(f"pyopencl cannot be loaded ({error})", INSTALL_HINT) from error
    return pyopencl


def _probed(index: int, device: Any, *, fresh: bool) -> DeviceInfo:
    platform = device.platform
    kind = _kind(device)
    identity = (VERSION, platform.name, platform.version, device.name, device.driver_version)
    path = cache.entry("devices", cache.digest(identity), ".json")
    verdict = None if fresh else _cached_verdict(path)
    if verdict is None:
        verdict = _probe(index, kind, platform.version)
        write_json(path, verdict)
    return DeviceInfo(index=index, kind=kind, **_names(device), **verdict)


def _kind(device: Any) -> str:
    types = _pyopencl().device_type
    if device.type & types.GPU:
        return "gpu"
    return "cpu" if device.type & types.CPU else "other"


def _cached_verdict(path: Any) -> dict[str, Any] | None:
    try:
        verdict = json.loads(path.read_text())
    except (OSError, ValueError):
        return None
    known = isinstance(verdict, dict) and set(verdict) == {"vector_width", "ok", "why"}
    return verdict if known else None


def _probe(index: int, kind: str, version: str) -> dict[str, Any]:
    """The widest vectors with which a child process builds and runs the self-test correctly."""
    complaints = []
    widths = (16, 8, 4) if kind == "cpu" else (4,)
    if "PoCL 3.0" in version:  # hangs or crashes on 16-wide vectors where the CPU has AVX-512
        widths = widths[1:]
        complaints.append("16-wide vectors are not tried on PoCL 3.0")
    for width in widths:
        complaint = _child_complaint(index, width)
        if complaint is None:
            return {"vector_width": width, "ok": True, "why": "; ".join(complaints)}
        complaints.append(f"{width}-wide vectors: {complaint}")
    return {"vector_width": 0, "ok": False, "why": "; ".join(complaints)}


def _child_complaint(index: int, width: int) -> str | None:
    """What went wrong in the self-test, or None."""
    command = [sys.executable, "-m", "coslobe.core.selftest", str(index), str(width)]
    try:
        child = subprocess.run(command, capture_output=True, text=True, timeout=PROBE_SECONDS, check=False)
    except subprocess.TimeoutExpired:
        return f"no answer within {PROBE_SECONDS} s"
    if child.returncode < 0:
        return f"the runtime crashed (signal {-child.returncode})"
    if child.returncode != 0:
        lines = child.stderr.strip().splitlines()
        return lines[-1] if lines else f"exit status {child.returncode}"
    return None


class Device:
    """An opened device: one context and one profiling queue.

    Contexts do not survive fork, so a device belongs to the process that opened it.
    """

    def __init__(self, info: DeviceInfo) -> None:
        self.info = info
        self._cl = _pyopencl()
        raw = raw_devices()[info.index]
        self.context = self._cl.Context([raw])
        properties = self._cl.command_queue_properties.PROFILING_ENABLE
        self.queue = self._cl.CommandQueue(self.context, raw, properties=properties)
        self._programs: dict[tuple[str, tuple[str, ...]], Any] = {}

    @property
    def has_doubles(self) -> bool:
        """Whether kernels may compute in double precision."""
        return "cl_khr_fp64" in self.queue.device.extensions.split()

    def describe(self) -> dict[str, Any]:
        """The device as plain data for manifests and reports."""
        return asdict(self.info)

    def build(self, units: Sequence[tuple[str, str]], defines: Mapping[str, int | float | str]) -> Any:
        """A program from (name, OpenCL C) `units` in order, specialised by `defines`, built once per variant.

        Raises
        ------
        CoslobeError
            The compiler refuses the source; the message carries its log.
        """
        source = "\n".join(f'#line 1 "{name}"\n{text}' for name, text in units)
        options = BUILD_OPTIONS + tuple(
            f"-D{name}={_literal(value)}" for name, value in sorted(defines.items())
        )
        key = (source, options)
        if key not in self._programs:
            try:
                with warnings.catch_warnings():  # some compilers always have something to say
                    warnings.simplefilter("ignore", self._cl.CompilerWarning)
                    self._programs[key] = self._cl.Program(self.context, source).build(list(options))
            except self._cl.Error as error:
                raise CoslobeError(
                    f"{self.info.title}: kernels do not build\n{error}", "try another --device"
                ) from error
        return self._programs[key]

    def upload(self, array: np.ndarray) -> Any:
        """A device buffer with the bytes of `array` (at least one byte: OpenCL has no empty buffers)."""
        flags = self._cl.mem_flags
        host = np.ascontiguousarray(array)
        if host.nbytes == 0:
            return self._cl.Buffer(self.context, flags.READ_WRITE, 4)
        return self._cl.Buffer(self.context, flags.READ_WRITE | flags.COPY_HOST_PTR, hostbuf=host)

    def allocate(self, nbytes: int) -> Any:
        """An uninitialised device buffer."""
        return self._cl.Buffer(self.context, self._cl.mem_flags.READ_WRITE, max(nbytes, 4))

    def local(self, nbytes: int) -> Any:
        """A kernel argument: memory that the work-items of a group share."""
        return self._cl.LocalMemory(nbytes)

    def write(self, buffer: Any, array: np.ndarray) -> None:
        """Replace the contents of a device buffer."""
        self._cl.enqueue_copy(self.queue, buffer, np.ascontiguousarray(array))

    def download(self, buffer: Any, shape: tuple[int, ...], dtype: Any) -> np.ndarray:
        """The contents of a device buffer; waits for the launches before it."""
        result = np.empty(shape, dtype)
        if result.nbytes:
            self._cl.enqueue_copy(self.queue, result, buffer)
        return result

    def launch(self, kernel: Any, n_items: int, group: int | None, *arguments: Any) -> "Launch":
        """Start `kernel` over `n_items` work-items (a multiple of `group`); returns at once."""
        event = kernel(self.queue, (n_items,), None if group is None else (group,), *arguments)
        return Launch(kernel.function_name, event)


@dataclass(frozen=True)
class Launch:
    """A named kernel launch and its profiling event."""

    name: str
    event: Any

    @property
    def seconds(self) -> float:
        """Time on the device; waits for the launch to end."""
        self.event.wait()
        return (self.event.profile.end - self.event.profile.start) * 1e-9


def open_device(wish: str | None = None) -> Device:
    """Select (see `select`) and open a device."""
    return Device(select(wish))


def struct_declaration(name: str, dtype: np.dtype) -> str:
    """The OpenCL C declaration of a packed struct whose fields are all 4-byte scalars or vectors of them.

    One dtype is the only source of each struct that host and device share; 4-byte fields need no padding,
    so the layout is the same on both sides by construction.
    """
    words = {np.dtype(np.float32): "float", np.dtype(np.int32): "int", np.dtype(np.uint32): "uint"}
    fields = []
    for field in dtype.names or ():
        part = dtype[field]
        base, shape = part.subdtype if part.subdtype else (part, ())
        if base not in words:
            raise TypeError(f"{name}.{field}: {base} is not a 4-byte scalar")
        fields.append(f"    {words[base]} {field}{''.join(f'[{n}]' for n in shape)};")
    if dtype.itemsize != sum(dtype[field].itemsize for field in dtype.names or ()):
        raise TypeError(f"{name}: the fields leave gaps or overlap")
    return "typedef struct {\n" + "\n".join(fields) + f"\n}} {name};\n"


def _literal(value: int | float | str) -> str:
    """A C literal; floats in the shortest form that gives back the same float32."""
    if isinstance(value, bool | np.bool_):
        return str(int(value))
    if isinstance(value, float | np.floating):
        with np.errstate(over="ignore"):  # what is too large is infinite
            single = np.float32(value)
        if np.isnan(single):
            raise ValueError("a kernel constant is not a number")
        return f"{single!s}f" if np.isfinite(single) else ("INFINITY" if single > 0 else "-INFINITY")
    return str(value)


def cpu_count() -> int:
    """CPUs that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
