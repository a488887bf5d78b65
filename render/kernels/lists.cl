/* Lists of near blockers: of the spheres that may come between a light and any point of a work-group, which points of
   neighbouring pixels share. Made by one work-item before the points are shaded.

   `near` holds NEAR_ROOM columns of six floats (x, y, z, radius, outside, owner's bits), `list` per light the first
   column and how many there are, filled up with spheres of radius -1 to whole vectors; ALL_GROUPS where the room did not
   suffice, BELOW where the light is below the horizon of all points. */
#define ALL_GROUPS -1
#define BELOW -2

/* A box around points, and one around their normals. */
typedef struct {
    float3 low, high, normal_low, normal_high;
} bounds_t;

inline float least(vf v)
{
#if VW == 16
    const float8 a = fmin(v.lo, v.hi);
    const float4 b = fmin(a.lo, a.hi);
#elif VW == 8
    const float4 b = fmin(v.lo, v.hi);
#else
    const float4 b = v;
#endif
    const float2 c = fmin(b.lo, b.hi);
    return fmin(c.x, c.y);
}

/* The least of each of three rows of a work-group's points, or the least of `sign` times them. */
inline float3 least_of(__global const float *rows, int stride, float sign)
{
    vf x = sign * VF_LOAD(rows), y = sign * VF_LOAD(rows + stride), z = sign * VF_LOAD(rows + 2 * stride);
    for (int i = VW; i < WORK_GROUP; i += VW) {
        x = fmin(x, sign * VF_LOAD(rows + i));
        y = fmin(y, sign * VF_LOAD(rows + stride + i));
        z = fmin(z, sign * VF_LOAD(rows + 2 * stride + i));
    }
    return (float3)(least(x), least(y), least(z));
}

/* Of the points of a work-group, whose rows begin at `points`. */
inline bounds_t bounds_of(__global const float *points, int stride)
{
    __global const float *positions = points + POSITION_X * stride, *normals = points + GEOMETRIC_X * stride;
    bounds_t b;
    b.low = least_of(positions, stride, 1.0f);
    b.high = -least_of(positions, stride, -1.0f);
    b.normal_low = least_of(normals, stride, 1.0f);
    b.normal_high = -least_of(normals, stride, -1.0f);
    return b;
}

/* Is all of a light below the horizon of every point? An upper bound of n.(centre - p) over both boxes. */
inline int is_below(const bounds_t *b, float3 centre, float radius)
{
    const float3 nearest = centre - b->high, farthest = centre - b->low;
    const float3 most = fmax(fmax(b->normal_low * nearest, b->normal_low * farthest),
                             fmax(b->normal_high * nearest, b->normal_high * farthest));
    return most.x + most.y + most.z < -1.0001f * radius;
}

/* Appends to the columns from `count` on those of VW spheres that a light with this cap meets from points up to `slack`
   around p; returns their new number, which may be one vector above NEAR_ROOM - VW. */
inline int append_near(const __local blockers_t *blockers, const cap_t *cap, int light, float3 p, float slack, int s, __local float *near,
                       int count)
{
    const vf x = VF_LOAD(blockers->x + s), y = VF_LOAD(blockers->y + s), z = VF_LOAD(blockers->z + s);
    const vf r = VF_LOAD(blockers->radius + s), ox = x - p.x, oy = y - p.y, oz = z - p.z;
    const vf along = ox * cap->a.x + oy * cap->a.y + oz * cap->a.z;
    const vi meets = meets_cap(cap, along, across_axis(cap, ox, oy, oz, along), ox * ox + oy * oy + oz * oz, r, slack);
    const vi owner = VI_LOAD(blockers->owner + s);
    for (uint lanes = lane_bits(meets & (owner != EMITTER_OWNER(light))); lanes; lanes &= lanes - 1) {
        const int from = s + lowest_bit(lanes);
        near[count] = blockers->x[from];
        near[NEAR_ROOM + count] = blockers->y[from];
        near[2 * NEAR_ROOM + count] = blockers->z[from];
        near[3 * NEAR_ROOM + count] = blockers->radius[from];
        near[4 * NEAR_ROOM + count] = blockers->outside[from];
        near[5 * NEAR_ROOM + count] = as_float(blockers->owner[from]);
        count++;
    }
    return count;
}

/* Fills `near` and `list` for the points of a work-group, whose rows begin at `points`. */
__attribute__((noinline))
void list_near(const __local blockers_t *blockers, __global const float *points, int stride, __global const light_t *lights, int n_lights,
                      __local float *near, __local int *list)
{
    const bounds_t bounds = bounds_of(points, stride);
    const float3 p = 0.5f * (bounds.low + bounds.high);
    const float slack = 1.0001f * length(bounds.high - p);
    int count = 0;
    for (int j = 0; j < n_lights; j++) {
        const float3 centre = vload3(0, lights[j].center);
        const float r = lights[j].radius;
        const cap_t cap = cap_of(centre - p, r);
        const int first = count;
        list[2 * j] = first;
        if (is_below(&bounds, centre, r)) {
            list[2 * j + 1] = BELOW;
            continue;
        }
        /* What a point sees of the light is no cone from the middle where that is inside of it or next to it. */
        if (cap.near <= slack || cap.tau < COS2_WIDE * cap.d * cap.d) {
            list[2 * j + 1] = ALL_GROUPS;
            continue;
        }
        int fits = 1;
        for (int g = 0; g < blockers->n_groups && fits; g += VW)
            for (uint groups = near_groups(blockers, &cap, g, p, slack); groups && fits; groups &= groups - 1) {
                const int begin = (g + lowest_bit(groups)) * GROUP;
                for (int s = begin; s < begin + GROUP && fits; s += VW) {
                    fits = count <= NEAR_ROOM - 2 * VW;
                    if (fits)
                        count = append_near(blockers, &cap, j, p, slack, s, near, count);
                }
            }
        if (fits) {
            list[2 * j + 1] = count - first;
            for (; count % VW; count++)
                near[3 * NEAR_ROOM + count] = -1.0f;
        } else {
            list[2 * j + 1] = ALL_GROUPS;
            count = first;
        }
    }
}
