"""The self-test itself: its NumPy twin against bits set one by one, and that it notices wrong answers."""

import subprocess
import sys

import numpy as np

from coslobe.core import selftest


def test_twin_against_bits_set_one_by_one():
    rng = np.random.default_rng(1)
    x = rng.uniform(-100, 900, 500).astype(np.float32)
    y = rng.uniform(-2, 12, 500).astype(np.float32)
    for a, b, bits in zip(x, y, selftest.expected_bits(x, y), strict=True):
        root = np.sqrt(max(a, np.float32(0)))
        first, last = np.ceil(min(root, 31)), np.floor(np.clip(root + b, 0, 31))
        mask = sum(1 << k for k in range(32) if first <= k <= last) if a > 0 else 0
        assert bits == mask ^ mask.bit_count()


def test_passes_with_the_width_chosen(device):
    selftest.run(device.info.index, device.info.vector_width)


def test_wrong_answers_end_the_child_with_a_reason(device):
    code = (
        "from coslobe.core import selftest\n"
        "selftest.SOURCE = selftest.SOURCE.replace('ceil(', 'floor(')\n"
        f"selftest.run({device.info.index}, {device.info.vector_width})"
    )
    child = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert child.returncode == 1
    assert child.stderr.strip().splitlines()[-1] == "ArithmeticError: wrong bits in the interval test"
