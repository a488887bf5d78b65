"""The numeric self-test of one device, run as a child process: `python -m coslobe.core.selftest INDEX WIDTH`.

It ends with status 0 where everything that the kernels rely on is compiled and computed correctly: wide
vectors with square roots, conversions, lane-wise selection, shifts and bit counts, local memory and
barriers. Otherwise the last line on stderr says what failed.
"""

import sys

import numpy as np

SOURCE = """
#define CAT_(a, b) a##b
#define CAT(a, b) CAT_(a, b)
typedef CAT(float, WIDTH) vf;
typedef CAT(int, WIDTH) vi;
typedef CAT(uint, WIDTH) vu;
__kernel void intervals(__global const float *x, __global const float *y, __global uint *bits) {
    __local float shared[64 * WIDTH];
    const int lid = get_local_id(0), gid = get_global_id(0);
    for (int k = 0; k < WIDTH; k++) shared[lid * WIDTH + k] = y[gid * WIDTH + k];
    barrier(CLK_LOCAL_MEM_FENCE);
    const vf a = CAT(vload, WIDTH)(gid, x), b = CAT(vload, WIDTH)(lid, shared);
    const vf root = sqrt(fmax(a, 0.0f));
    const vi first = CAT(convert_int, WIDTH)(ceil(clamp(root, 0.0f, 31.0f)));
    const vi last = CAT(convert_int, WIDTH)(floor(clamp(root + b, 0.0f, 31.0f)));
    const vu from = (vu)(0xffffffffu) << CAT(as_uint, WIDTH)(first);
    const vu mask = from & ((vu)(0xffffffffu) >> CAT(as_uint, WIDTH)(31 - last));
    const vi keep = (last >= first) & (a > 0.0f);
    const vu kept = mask & CAT(as_uint, WIDTH)(keep);
    CAT(vstore, WIDTH)(kept ^ popcount(kept), gid, bits);
}
__kernel void transcendental(__global const float *x, __global float *y) {
    const int i = get_global_id(0);
    const vf v = CAT(vload, WIDTH)(i, x);
    CAT(vstore, WIDTH)(exp(-v) + log(v + 1.0f), i, y);
}
"""


def expected_bits(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """NumPy twin of the kernel `intervals` (float32 in, uint32 out)."""
    root = np.sqrt(np.maximum(x, np.float32(0)))
    first = np.ceil(np.clip(root, 0, 31)).astype(np.int64)
    last = np.floor(np.clip(root + y, 0, 31)).astype(np.int64)
    mask = (0xFFFFFFFF << first) & 0xFFFFFFFF & (0xFFFFFFFF >> (31 - last))
    kept = np.where((last >= first) & (x > 0), mask, 0).astype(np.uint32)
    return kept ^ np.bitwise_count(kept).astype(np.uint32)


def run(index: int, width: int) -> None:
    """Raise where the device gives a wrong answer."""
    import pyopencl as cl

    from coslobe.core.device import BUILD_OPTIONS, raw_devices

    raw = raw_devices()[index]
    context = cl.Context([raw])
    queue = cl.CommandQueue(context)
    program = cl.Program(context, SOURCE).build([*BUILD_OPTIONS, f"-DWIDTH={width}"])
    rng = np.random.default_rng(0)
    x = rng.uniform(-100, 900, 1024 * width).astype(np.float32)
    y = rng.uniform(-2, 12, x.size).astype(np.float32)
    flags = cl.mem_flags
    inputs = [cl.Buffer(context, flags.READ_ONLY | flags.COPY_HOST_PTR, hostbuf=v) for v in (x, y)]
    result = cl.Buffer(context, flags.READ_WRITE, x.nbytes)
    bits = np.empty(x.size, np.uint32)
    program.intervals(queue, (1024,), (64,), *inputs, result)
    cl.enqueue_copy(queue, bits, result)
    if not np.array_equal(bits, expected_bits(x, y)):
        raise ArithmeticError("wrong bits in the interval test")
    t = rng.uniform(0, 20, x.size).astype(np.float32)
    source = cl.Buffer(context, flags.READ_ONLY | flags.COPY_HOST_PTR, hostbuf=t)
    values = np.empty(x.size, np.float32)
    program.transcendental(queue, (1024,), (64,), source, result)
    cl.enqueue_copy(queue, values, result)
    exact = np.exp(-t.astype(np.float64)) + np.log1p(t.astype(np.float64))
    if not np.allclose(values, exact, rtol=2e-6, atol=1e-7):
        raise ArithmeticError("wrong exponentials or logarithms")


if __name__ == "__main__":
    run(int(sys.argv[1]), int(sys.argv[2]))
