// One step of Adam (Kingma and Ba 2015) on the sum of the rows of `partial` [n_rows][n_spheres], in their
// order. mean and square: running moments; `step` counts from 1. Radii stay above SMALLEST.
// Host side: descent.py, with the float64 twin.
__kernel void adam(__global const float4 *partial, int n_rows, int n_spheres, int step, float rate,
                   __global float4 *mean, __global float4 *square, __global float4 *spheres) {
    const int s = get_global_id(0);
    float4 g = 0.0f;
    for (int row = 0; row < n_rows; row++) g += partial[row * n_spheres + s];
    const float4 m = mean[s] = BETA1 * mean[s] + (1.0f - BETA1) * g;
    const float4 v = square[s] = BETA2 * square[s] + (1.0f - BETA2) * g * g;
    const float4 m_hat = m / (1.0f - pown(BETA1, step)), v_hat = v / (1.0f - pown(BETA2, step));
    float4 sphere = spheres[s] - rate * m_hat / (sqrt(v_hat) + 1e-8f);
    sphere.w = fmax(sphere.w, SMALLEST);
    spheres[s] = sphere;
}
