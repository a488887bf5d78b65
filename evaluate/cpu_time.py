"""The processor time of kernels, which other processes on the machine hardly change."""

import time
from typing import Any

from coslobe.core.device import Device, DeviceInfo, Launch


class TimedDevice(Device):
    """A device of its own that waits for every launch and takes its time.

    Attributes
    ----------
    seconds : float
        Of the last launch: on a CPU the processor time of all threads, which holds what starting a kernel
        takes (some ten microseconds); elsewhere the time by the device's clock.
    """

    def __init__(self, info: DeviceInfo) -> None:
        super().__init__(info)
        self.seconds = 0.0

    def launch(self, kernel: Any, n_items: int, group: int | None, *arguments: Any) -> Launch:
        """As `Device.launch`, but returns when the kernel has ended."""
        start = time.process_time()
        launch = super().launch(kernel, n_items, group, *arguments)
        launch.event.wait()
        taken = time.process_time() - start
        self.seconds = taken if self.info.kind == "cpu" else launch.seconds
        return launch
