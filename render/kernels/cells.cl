/* Integrals over the cells of the mask. */

/* Values of the cells in column c whose bit is set, 0 of the others. */
inline rf where_bit(ru rows, int c, rf value)
{
    return select((rf)(0.0f), value, AS_RI(rows << (31 - c)));
}

/* Sums of solid angle times cosine, (n.p) / l^4, over the cells of the light's disk, over all (x) and over lit ones (y).
   Columns that mirror each other have the same l and, of the disk, the same rows. */
inline float2 diffuse_cells(const ru *lit, __constant uint *disk, float h, float3 n)
{
    rf all = 0.0f, some = 0.0f;
    for (int k = 0; k < NR; k++) {
        const rf y = row_centres(k) * h, height = n.y * y + n.z, y2 = y * y + 1.0f;
        const ru inside = RU_LOAD(k, disk);
        for (int c = 0; c < ROWS / 2; c++) {
            const float x = column_centre(c) * h;
            const rf inverse2 = 1.0f / (x * x + y2), weight = inverse2 * inverse2;
            const rf left = weight * fmax(height + n.x * x, 0.0f), right = weight * fmax(height - n.x * x, 0.0f);
            all += where_bit(inside, c, left + right);
            some += where_bit(lit[k], c, left) + where_bit(lit[k], ROWS - 1 - c, right);
        }
    }
    return (float2)(row_sum(all), row_sum(some));
}

/* Along a row, the logarithm of lobe times solid angle is a polynomial of degree 4 in x up to (e + 4) h^5 / 5000 of the
   lit share: from five samples (Chebyshev's, of the span of the cells' centres). Coefficients in x from -1 to 1. */
typedef struct {
    rf c0, c1, c2, c3, c4;
} profile_t;

#define FAR_NODE (0.951056516f * (1.0f - 1.0f / ROWS))
#define NEAR_NODE (0.587785252f * (1.0f - 1.0f / ROWS))

/* log of the lobe over l^power at (x, y) in the plane of the mask, l the length of (x, y, 1); power 3 makes it lobe times
   solid angle, 4 stands for the cosine's length as well. */
inline rf log_cells(float x, rf y, float3 r, float e, float power)
{
    const rf length2 = x * x + y * y + 1.0f, inverse = rsqrt(length2);
    const rf dx = x * inverse - r.x, dy = y * inverse - r.y, dz = inverse - r.z;
    return e * log_rows(0.5f * (dx * dx + dy * dy + dz * dz)) - 0.5f * power * ln_rows(length2);
}

inline profile_t profile_of(rf y, float h, float3 r, float e, float power)
{
    const float far2 = FAR_NODE * FAR_NODE, near2 = NEAR_NODE * NEAR_NODE;
    const rf middle = log_cells(0.0f, y, r, e, power);
    const rf far_right = log_cells(FAR_NODE * h, y, r, e, power), far_left = log_cells(-FAR_NODE * h, y, r, e, power);
    const rf near_right = log_cells(NEAR_NODE * h, y, r, e, power), near_left = log_cells(-NEAR_NODE * h, y, r, e, power);
    const rf far_even = (0.5f * (far_right + far_left) - middle) * (1.0f / far2);
    const rf near_even = (0.5f * (near_right + near_left) - middle) * (1.0f / near2);
    const rf far_odd = (far_right - far_left) * (0.5f / FAR_NODE), near_odd = (near_right - near_left) * (0.5f / NEAR_NODE);
    profile_t p;
    p.c0 = middle;
    p.c4 = (far_even - near_even) * (1.0f / (far2 - near2));
    p.c2 = far_even - p.c4 * far2;
    p.c3 = (far_odd - near_odd) * (1.0f / (far2 - near2));
    p.c1 = far_odd - p.c3 * far2;
    return p;
}

/* Columns in which some row has a set bit. */
inline uint columns_with_bits(const ru *rows)
{
    ru any_row = rows[0];
    for (int k = 1; k < NR; k++)
        any_row |= rows[k];
    return row_or(any_row);
}

/* The sums of glossy_sums for a light wholly above the horizon and near the lobe's side, row by row as profiles. */
inline float2 smooth_sums(const ru *lit, const ru *whole, float h, float3 n, float3 r, float e, int cosine)
{
    rf all = 0.0f, some = 0.0f;
    const uint columns = columns_with_bits(whole);
    const int last = 31 - clz(columns | 1), first = columns ? lowest_bit(columns) : 0;
    for (int k = 0; k < NR; k++) {
        const rf y = row_centres(k) * h, height = cosine ? n.y * y + n.z : (rf)(1.0f);
        const float slope = cosine ? n.x * h : 0.0f;
        const profile_t p = profile_of(y, h, r, e, cosine ? 4.0f : 3.0f);
        ru within = whole[k] << (31 - last), seen = lit[k] << (31 - last); /* the column at hand in the highest bit */
        for (int c = last; c >= first; c--) {
            const float x = column_centre(c);
            const rf value = exp_rows(p.c0 + x * (p.c1 + x * (p.c2 + x * (p.c3 + x * p.c4)))) * (height + slope * x);
            all += select((rf)(0.0f), value, AS_RI(within));
            some += select((rf)(0.0f), value, AS_RI(seen));
            within += within;
            seen += seen;
        }
    }
    return (float2)(row_sum(all), row_sum(some));
}

/* Sums over the cells of a light with a lobe of exponent e around the unit vector r: solid angle times lobe times the
   cosine to the normal over all cells (x) and over lit ones (y); without `cosine`, cosines count as 1 above the horizon.
   Where the horizon `cut`s the light, x has the cosine to r instead. A lobe that falls between the cells' centres is widened
   until neighbouring cells share it. */
inline float2 glossy_sums(const ru *lit, const ru *whole, float h, float3 n, float3 r, float e, int cosine, int cut)
{
    const float exponent = fmin(e, (float)(ROWS * ROWS) / (h * h)); /* half a cell wide at least */
    const float h2 = h * h;
    if (!cut && (exponent + 4.0f) * h2 * h2 * h < SMOOTH_ROWS && r.z - h * (fabs(r.x) + fabs(r.y)) > 0.5f)
        return smooth_sums(lit, whole, h, n, r, exponent, cosine);
    rf all = 0.0f, some = 0.0f;
    for (int k = 0; k < NR; k++) {
        const rf y = row_centres(k) * h;
        for (int c = 0; c < ROWS; c++) {
            const float x = column_centre(c) * h;
            const rf inverse = rsqrt(x * x + y * y + 1.0f);
            const rf omega = where_bit(whole[k], c, inverse * inverse * inverse);
            const rf dx = x * inverse - r.x, dy = y * inverse - r.y, dz = inverse - r.z;
            const rf q = 0.5f * (dx * dx + dy * dy + dz * dz);
            const rf lobe = omega * lobe_rows(q, (rf)(exponent));
            const rf height = fmax((n.x * x + n.y * y + n.z) * inverse, 0.0f);
            const rf value = cosine ? lobe * height : select((rf)(0.0f), lobe, height > 0.0f);
            if (cut)
                all += cosine ? lobe * (1.0f - q) : lobe;
            else
                all += value;
            some += where_bit(lit[k], c, value);
        }
    }
    return (float2)(row_sum(all), row_sum(some));
}

/* The same over the light's own mask. */
inline float2 glossy_cells(const ru *lit, __constant uint *disk, float h, float3 n, float3 r, float e, int cosine, int cut)
{
    ru whole[NR];
    for (int k = 0; k < NR; k++)
        whole[k] = RU_LOAD(k, disk);
    return glossy_sums(lit, whole, h, n, r, e, cosine, cut);
}

/* The sums over a mask of the lobe's own, for a lobe so much narrower than the light that the light's cells are too
   coarse for the edges of shadows in it: a disk of WINDOW lobe widths around its axis, in which the light's outline is
   one more edge. x is negative where the light hardly reaches into the disk. */
inline float2 window_cells(const bound_lobe_t *lobe, const receiver_t *receiver, const cap_t *cap, int cut,
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
        return (float2)(1.0f, 0.0f);
    for (int k = 0; k < NR; k++)
        lit[k] = whole[k] & ~mask[k];
    return glossy_sums(lit, whole, h, in_frame(receiver->shading, t, u, window.a), (float3)(0.0f, 0.0f, 1.0f),
                       lobe->exponent, lobe->cosine, cut);
}
