/* The visibility mask: ROWS x ROWS bits over the square that circumscribes the light's cone, at distance 1 along
   the frame's third axis, |x|, |y| <= h. Bit c of row r is the cell centred at x = ((c + 1/2) 2 / ROWS - 1) h and
   y = ((r + 1/2) 2 / ROWS - 1) h; 1 means blocked. Twins: coslobe.render.mask. */

/* A frame (t, u, a) around the unit vector a (Duff et al. 2017), turned by a fraction of a full turn. */
inline void frame_around(float3 a, float turn, float3 *t, float3 *u)
{
    float sine;
    const float cosine = sincos_turn(turn, &sine);
    const float sign = copysign(1.0f, a.z);
    const float k = -1.0f / (sign + a.z), b = a.x * a.y * k;
    const float3 t0 = (float3)(1.0f + sign * a.x * a.x * k, sign * b, -sign * a.x);
    const float3 u0 = (float3)(b, sign + a.y * a.y * k, -a.y);
    *t = cosine * t0 + sine * u0;
    *u = cosine * u0 - sine * t0;
}

/* Coordinates of v in the frame (t, u, a). */
inline float3 in_frame(float3 v, float3 t, float3 u, float3 a)
{
    return (float3)(dot(v, t), dot(v, u), dot(v, a));
}

/* y of the rows of vector k, for h = 1. */
inline rf row_centres(int k)
{
    return (row_numbers() + (k * RW + 0.5f)) * (2.0f / ROWS) - 1.0f;
}

/* x of a column, for h = 1. */
inline float column_centre(int c)
{
    return (c + 0.5f) * (2.0f / ROWS) - 1.0f;
}

#define MIDDLE (0.5f * ROWS + 0.5f) /* of a row of cells, in units of which the left edge is 1/2 */

/* The bits of cells from `low` to `high`, in cell units, 1/2 at the left edge, where `valid`. FIRST and LAST round by the
   mask's mode: a cell counts where its centre, all of it, or any of it is covered. Truncation stands for ceil and floor,
   which runtimes spell out in many instructions; it differs only where an edge is a whole number of cells. */
inline ru interval_bits(rf low, rf high, ri valid)
{
    const rf first = fmax(low - (-0.5f - FIRST), 0.0f), end = fmin(high - (-0.5f - LAST), (float)ROWS);
    const ru bits = ((ru)(0xffffffffu) << AS_RU(TO_RI(first) & 31)) & ((ru)(0xffffffffu) >> AS_RU(-TO_RI(end) & 31));
    return select((ru)(0), bits, AS_RU(valid & (first < 32.0f) & (end >= 1.0f)));
}

/* A sphere whose outline on the mask's plane is an ellipse within reach, by what its rows need, in cell units: with y
   from -1 to 1, it covers half a chord of sqrt(size + growth y^2 - (offset - slope y)^2) around middle + shear y. */
typedef struct {
    float middle, shear, offset, slope, size, growth;
} ellipse_t;

/* What it covers in the rows of vector k. */
inline ru ellipse_bits(const ellipse_t *e, int k)
{
    const rf y = row_centres(k);
    const rf middle = e->middle + e->shear * y, c = e->offset - e->slope * y;
    const rf disc = e->size + e->growth * (y * y) - c * c;
    const rf root = sqrt(fmax(disc, 0.0f));
    return interval_bits(middle - root, middle + root, disc > 0.0f);
}

/* Ellipses of VW spheres at a time. o = (ox, oy, oz) is a centre in the mask's frame, tau = max(|o|^2 - r^2, 0) the
   square of the tangent's length, rho2 = min(r^2, |o|^2): a point inside a sphere sees it as a half-space.
   Per row (o.p)^2 >= tau |p|^2 with p = (x, y, 1) is a quadratic in x. Its discriminant is written as
   tau (rho2 (y^2 + 1) - (oy - oz y)^2), which does not cancel for small caps (theory, section 5). */
typedef struct {
    vf middle, shear, offset, slope, size, growth;
    vf begin, end; /* rows */
} ellipses_t;

/* The lanes for which that holds; others are for splat_outline. */
inline vi ellipses_of(ellipses_t *e, float h, vf ox, vf oy, vf oz, vf tau, vf rho2)
{
    const float cells = 0.5f * ROWS / h;
    const vf a2 = ox * ox - tau, inverse = -cells / a2;
    const vf scale = inverse * sqrt(tau);
    e->shear = h * inverse * ox * oy;
    e->middle = inverse * ox * oz + MIDDLE;
    e->offset = scale * oy;
    e->slope = scale * oz * h;
    e->size = scale * scale * rho2;
    e->growth = e->size * (h * h);
    /* The rows that it reaches, where that is an interval. */
    const vf q = oz * oz - rho2, to_rows = cells / fmax(q, 1e-30f);
    const vf centre = oy * oz * to_rows + 0.5f * ROWS, reach = sqrt(fmax(rho2 * (q + oy * oy), 0.0f)) * to_rows + 0.01f;
    const vi all = q <= 1e-3f * rho2;
    e->begin = select(centre - reach - 0.5f, (vf)(0.0f), all);
    e->end = select(centre + reach + 0.5f, (vf)(ROWS), all);
    return (a2 < -0.25f * (tau + rho2)) & (oz > fabs(oy) * h);
}

/* Mark what a sphere covers whose outline is no ellipse within reach; o, tau and rho2 as above. */
inline void splat_outline(ru *mask, float h, float ox, float oy, float oz, float tau, float rho2)
{
    const float a2 = ox * ox - tau;
    const float cells = 0.5f * ROWS / h;
    /* Roots in the form that survives a2 = 0. Straight ahead of a point inside the sphere they would be 0 / 0; any trace
       of ox then puts them far outside the plane. */
    ox = fabs(ox) < 1e-20f ? 1e-20f : ox;
    for (int k = 0; k < NR; k++) {
        const rf y = row_centres(k) * h;
        const rf u = oy * y + oz, b = ox * u, c = oy - oz * y;
        const rf disc = tau * (rho2 * (y * y + 1.0f) - c * c);
        const rf root = sqrt(fmax(disc, 0.0f));
        const rf q = -(b + copysign(root, b));
        const rf product = u * u - tau * (y * y + 1.0f); /* a2 x1 x2 */
        const rf safe = select(q, (rf)(1e-30f), q == 0.0f);
        const rf x1 = q / (a2 == 0.0f ? 1e-30f : a2), x2 = product / safe;
        const rf lower = fmin(x1, x2), upper = fmax(x1, x2);
        rf low, high;
        ri valid;
        if (a2 < 0.0f) {
            low = lower;
            high = upper;
            valid = (disc > 0.0f) & (u > 0.0f);
        } else { /* the cap contains the direction (+-1, 0, 0): one ray, on the side of o */
            low = ox > 0.0f ? upper : (rf)(-INFINITY);
            high = ox > 0.0f ? (rf)(INFINITY) : lower;
            valid = (ri)(-1);
        }
        mask[k] |= interval_bits(low * cells + MIDDLE, high * cells + MIDDLE, valid);
    }
}

/* Mark what a sphere covers. */
inline void splat_sphere(ru *mask, float h, float ox, float oy, float oz, float tau, float rho2)
{
    ellipses_t e;
    const vi simple = ellipses_of(&e, h, (vf)(ox), (vf)(oy), (vf)(oz), (vf)(tau), (vf)(rho2));
    const ellipse_t one = {e.middle.s0, e.shear.s0, e.offset.s0, e.slope.s0, e.size.s0, e.growth.s0};
    if (!simple.s0) {
        splat_outline(mask, h, ox, oy, oz, tau, rho2);
        return;
    }
    for (int k = 0; k < NR; k++)
        mask[k] |= ellipse_bits(&one, k);
}

/* Mark what lies below the plane with normal n (in the mask's frame). */
inline void splat_horizon(ru *mask, float h, float3 n)
{
    const float cells = 0.5f * ROWS / h;
    for (int k = 0; k < NR; k++) {
        const rf height = n.y * row_centres(k) * h + n.z;
        if (fabs(n.x) * h > 1e-6f * fabs(n.z)) {
            const rf edge = -height / n.x * cells + MIDDLE;
            const rf low = n.x > 0.0f ? (rf)(-INFINITY) : edge, high = n.x > 0.0f ? edge : (rf)(INFINITY);
            mask[k] |= interval_bits(low, high, (ri)(-1));
        } else {
            mask[k] |= interval_bits((rf)(-INFINITY), (rf)(INFINITY), height < 0.0f);
        }
    }
}

/* Mark those cells of `candidates` where the ray enters a sphere before the light: for blockers that reach into the
   range of depths that the light's surface spans. o and rho2 as in splat_sphere, light the centre of the light in the
   mask's frame, light_rho2 the square of its radius. Half a chord, times |p|, is the root of rho^2 |p|^2 - |o x p|^2: the
   textbook (o.p)^2 / |p|^2 - tau has no digits left for a small sphere far away. */
inline void splat_near_light(ru *mask, const ru *candidates, float h, float ox, float oy, float oz, float rho2,
                             float3 light, float light_rho2)
{
    for (int k = 0; k < NR; k++) {
        const rf y = row_centres(k) * h;
        const rf cx = oy - oz * y, lx = light.y - light.z * y;
        const ru open = candidates[k] & ~mask[k];
        for (uint columns = row_or(open); columns; columns &= columns - 1) {
            const int c = lowest_bit(columns);
            const float x = column_centre(c) * h;
            const rf cz = ox * y - oy * x, lz = light.x * y - light.y * x;
            const float cy = oz * x - ox, ly = light.z * x - light.x;
            const rf length2 = x * x + y * y + 1.0f;
            const rf chord = sqrt(fmax(rho2 * length2 - (cx * cx + cz * cz + cy * cy), 0.0f));
            const rf light_chord = sqrt(fmax(light_rho2 * length2 - (lx * lx + lz * lz + ly * ly), 0.0f));
            /* The middle of one chord than of the other. */
            const rf farther = (ox - light.x) * x + (oy - light.y) * y + (oz - light.z);
            mask[k] |= open & AS_RU(farther < chord - light_chord) & (1u << c);
        }
    }
}

/* Number of set bits and the sums of column positions and of y over them, x and y in the frame's units. Fields of 2, 4 and
   8 bits hold counts and sums of positions within the field, each from the two halves of the next; runtimes would count
   the bits of a vector lane by lane. */
inline float3 bit_moments(const ru *bits, float h)
{
    rf count = 0.0f, column = 0.0f, row = 0.0f;
    for (int k = 0; k < NR; k++) {
        const ru odd = (bits[k] >> 1) & 0x55555555u, pairs = (bits[k] & 0x55555555u) + odd;
        const ru high2 = (pairs >> 2) & 0x33333333u, nibbles = (pairs & 0x33333333u) + high2;
        const ru at4 = (odd & 0x33333333u) + ((odd >> 2) & 0x33333333u) + (high2 << 1);
        const ru high4 = (nibbles >> 4) & 0x0f0f0f0fu, bytes = (nibbles & 0x0f0f0f0fu) + high4;
        const ru at8 = (at4 & 0x0f0f0f0fu) + ((at4 >> 4) & 0x0f0f0f0fu) + (high4 << 2);
        /* Sums over the four bytes, with their own positions 0 to 3 for the columns. */
        const rf n = TO_RF((bytes * 0x01010101u) >> 24);
        count += n;
        column += TO_RF(((at8 * 0x01010101u) >> 24) + (((bytes * 0x00010203u) >> 24) << 3));
        row += n * row_centres(k);
    }
    const float n = row_sum(count);
    const float x = (row_sum(column) + 0.5f * n) * (2.0f / ROWS) - n;
    return (float3)(n, x * h, row_sum(row) * h);
}
