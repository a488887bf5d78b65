/* Integrals over the cells of the mask. */

/* Values of the cells in column c whose bit is set, 0 of the others. */
inline rf where_bit(ru rows, int c, rf value)
{
    return select((rf)(0.0f), value, AS_RI(rows << (31 - c)));
}

/* Sums of solid angle times cosine over the cells of the light's disk, over all (x) and over lit ones (y). */
inline float2 diffuse_cells(const ru *lit, __constant uint *disk, float h, float3 n)
{
    rf all = 0.0f, some = 0.0f;
    for (int k = 0; k < NR; k++) {
        const rf y = row_centres(k) * h;
        const ru inside = RU_LOAD(k, disk);
        for (int c = 0; c < ROWS; c++) {
            const float x = column_centre(c) * h;
            const rf inverse = rsqrt(x * x + y * y + 1.0f);
            const rf omega = where_bit(inside, c, inverse * inverse * inverse);
            const rf value = omega * fmax((n.x * x + n.y * y + n.z) * inverse, 0.0f);
            all += value;
            some += where_bit(lit[k], c, value);
        }
    }
    return (float2)(row_sum(all), row_sum(some));
}

/* Sums over the cells of the light's disk with a lobe of exponent e around the unit vector r: solid angle times lobe
   times the cosine to r (x), to the normal over all (y) and over lit cells (z); without `cosine`, cosines count as 1
   above the horizon. A lobe that falls between the cells' centres is widened until neighbouring cells share it. */
inline float3 glossy_cells(const ru *lit, __constant uint *disk, float h, float3 n, float3 r, float e, int cosine)
{
    rf around = 0.0f, all = 0.0f, some = 0.0f;
    const float exponent = fmin(e, (float)(ROWS * ROWS) / (h * h)); /* half a cell wide at least */
    for (int k = 0; k < NR; k++) {
        const rf y = row_centres(k) * h;
        const ru inside = RU_LOAD(k, disk);
        for (int c = 0; c < ROWS; c++) {
            const float x = column_centre(c) * h;
            const rf inverse = rsqrt(x * x + y * y + 1.0f);
            const rf omega = where_bit(inside, c, inverse * inverse * inverse);
            const rf dx = x * inverse - r.x, dy = y * inverse - r.y, dz = inverse - r.z;
            const rf q = 0.5f * (dx * dx + dy * dy + dz * dz);
            const rf lobe = omega * lobe_rows(q, exponent);
            const rf height = fmax((n.x * x + n.y * y + n.z) * inverse, 0.0f);
            const rf value = cosine ? lobe * height : select((rf)(0.0f), lobe, height > 0.0f);
            around += cosine ? lobe * (1.0f - q) : lobe;
            all += value;
            some += where_bit(lit[k], c, value);
        }
    }
    return (float3)(row_sum(around), row_sum(all), row_sum(some));
}
