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

/* Sums over the cells of a light with a lobe of exponent e around the unit vector r: solid angle times lobe times the
   cosine to r (x), to the normal over all cells (y) and over lit ones (z); without `cosine`, cosines count as 1 above
   the horizon. A lobe that falls between the cells' centres is widened until neighbouring cells share it. */
inline float3 glossy_sums(const ru *lit, const ru *whole, float h, float3 n, float3 r, float e, int cosine)
{
    rf around = 0.0f, all = 0.0f, some = 0.0f;
    const float exponent = fmin(e, (float)(ROWS * ROWS) / (h * h)); /* half a cell wide at least */
    for (int k = 0; k < NR; k++) {
        const rf y = row_centres(k) * h;
        for (int c = 0; c < ROWS; c++) {
            const float x = column_centre(c) * h;
            const rf inverse = rsqrt(x * x + y * y + 1.0f);
            const rf omega = where_bit(whole[k], c, inverse * inverse * inverse);
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

/* The same over the light's own mask. */
inline float3 glossy_cells(const ru *lit, __constant uint *disk, float h, float3 n, float3 r, float e, int cosine)
{
    ru whole[NR];
    for (int k = 0; k < NR; k++)
        whole[k] = RU_LOAD(k, disk);
    return glossy_sums(lit, whole, h, n, r, e, cosine);
}

/* The sums over a mask of the lobe's own, for a lobe so much narrower than the light that the light's cells are too
   coarse for the edges of shadows in it: a disk of WINDOW lobe widths around its axis, in which the light's outline is
   one more edge. x is negative where the light hardly reaches into the disk. */
inline float3 window_cells(const bound_lobe_t *lobe, const receiver_t *receiver, const cap_t *cap,
                           const __local blockers_t *blockers, int light, __constant uint *disk, uint *splats)
{
    cap_t window = *cap;
    window.a = lobe->axis;
    window.sine = WINDOW * rsqrt(lobe->exponent + 1.0f);
    window.cosine = sqrt(1.0f - window.sine * window.sine);
    const float h = window.sine / window.cosine;
    float3 t, u;
    frame_around(window.a, receiver->turn, &t, &u);
    ru mask[NR], whole[NR], lit[NR];
    for (int k = 0; k < NR; k++)
        mask[k] = whole[k] = 0;
    const float3 centre = in_frame(cap->centre, t, u, window.a);
    splat_sphere(whole, h, centre.x, centre.y, centre.z, cap->tau, cap->radius2);
    for (int k = 0; k < NR; k++)
        whole[k] &= RU_LOAD(k, disk);
    if (bit_moments(whole, h).x < FEWEST_CELLS)
        return -1.0f;
    const float3 horizon = in_frame(receiver->geometric, t, u, window.a);
    if (horizon.z < window.sine)
        splat_horizon(mask, h, horizon);
    if (visibility(blockers, receiver, &window, light, &t, &u, 1, mask, splats) == DARK)
        return (float3)(1.0f, 1.0f, 0.0f);
    for (int k = 0; k < NR; k++)
        lit[k] = whole[k] & ~mask[k];
    return glossy_sums(lit, whole, h, in_frame(receiver->shading, t, u, window.a), (float3)(0.0f, 0.0f, 1.0f),
                       lobe->exponent, lobe->cosine);
}
