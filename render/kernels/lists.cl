/* Lists of near blockers: of the spheres that may come between a light and any point of a work-group, which points of
   neighbouring pixels share. Made by one work-item before the points are shaded.

   `near` holds NEAR_ROOM columns of NEAR_ROWS floats (x, y, z, radius, outside, owner's bits, apparent size), `list` per light
   the first column and how many there are, filled up with spheres of radius -1 to whole vectors; ALL_GROUPS where the
   room did not suffice, BELOW where the light is below the horizon of all points. */
#define ALL_GROUPS -1
#define BELOW -2
#define NEAR_ROWS 7

/* Of lists that are not short, so many of the largest spheres are tried for what they hide, unless several in a row hide
   nothing. */
#define FEW_NEAR 12
#define LARGEST_NEAR 64
#define IDLE_NEAR 16

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

/* The box around three rows of a work-group's points. */
inline void box_around(__global const float *rows, int stride, float3 *low, float3 *high)
{
    float lows[3], highs[3];
    for (int k = 0; k < 3; k++) {
        __global const float *row = rows + k * stride;
        vf lowest = VF_LOAD(row), highest = lowest;
        for (int i = VW; i < WORK_GROUP; i += VW) {
            const vf v = VF_LOAD(row + i);
            lowest = fmin(lowest, v);
            highest = fmax(highest, v);
        }
        lows[k] = least(lowest);
        highs[k] = -least(-highest);
    }
    *low = vload3(0, lows);
    *high = vload3(0, highs);
}

/* Of the points of a work-group, whose rows begin at `points`. */
inline bounds_t bounds_of(__global const float *points, int stride)
{
    bounds_t b;
    box_around(points + POSITION_X * stride, stride, &b.low, &b.high);
    box_around(points + GEOMETRIC_X * stride, stride, &b.normal_low, &b.normal_high);
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
    float size[VW];
    VF_STORE(r * r / (ox * ox + oy * oy + oz * oz), size);
    for (uint lanes = lane_bits(meets & (owner != EMITTER_OWNER(light))); lanes; lanes &= lanes - 1) {
        const int from = s + lowest_bit(lanes);
        near[count] = blockers->x[from];
        near[NEAR_ROOM + count] = blockers->y[from];
        near[2 * NEAR_ROOM + count] = blockers->z[from];
        near[3 * NEAR_ROOM + count] = blockers->radius[from];
        near[4 * NEAR_ROOM + count] = blockers->outside[from];
        near[5 * NEAR_ROOM + count] = as_float(blockers->owner[from]);
        near[6 * NEAR_ROOM + count] = size[from - s];
        count++;
    }
    return count;
}

/* Moves the column of the largest apparent size to the first; columns from `end` to the next whole vector have none. */
inline void bring_largest(__local float *near, int first, int end)
{
    __local const float *sizes = near + 6 * NEAR_ROOM;
    vf most = 0.0f;
    for (int s = first; s < end; s += VW)
        most = fmax(most, VF_LOAD(sizes + s));
    const float size = -least(-most);
    uint found = 0;
    int largest = first - VW;
    while (!found) {
        largest += VW;
        found = lane_bits(VF_LOAD(sizes + largest) >= size);
    }
    largest += lowest_bit(found);
    for (int k = 0; k < NEAR_ROWS; k++) {
        const float kept = near[k * NEAR_ROOM + first];
        near[k * NEAR_ROOM + first] = near[k * NEAR_ROOM + largest];
        near[k * NEAR_ROOM + largest] = kept;
    }
}

/* Does column b block the whole light before it is reached, from every point where it counts as it is? A point that it
   contains, or that lies on its own object within its bulge (own_radius), sees less of it. */
inline int is_solid(const cap_t *cap, const __local float *near, int b, float3 p, float slack)
{
    const float3 o = (float3)(near[b], near[NEAR_ROOM + b], near[2 * NEAR_ROOM + b]) - p;
    const float r = near[3 * NEAR_ROOM + b], d2 = dot(o, o), nearest = r + slack + 2.0f * near[4 * NEAR_ROOM + b];
    const float before = cap->near - 2.0f * slack;
    return d2 > nearest * nearest && before > 0.0f && d2 - r * r < before * before;
}

/* Drops the columns from `first` to `count` that others hide from all points; returns how many are left. A sphere scaled
   by f about a point looks the same from there; from points up to `slack` away it moves by |1 - f| slack. So another one
   hides it that contains it with this margin for some f. */
inline int drop_hidden(const cap_t *cap, __local float *near, int first, int count, float3 p, float slack)
{
    int idle = 0;
    for (int b = first; b < min(first + LARGEST_NEAR, count) && idle < IDLE_NEAR; b++) {
        VF_STORE((vf)(-1.0f), near + 6 * NEAR_ROOM + count);
        bring_largest(near, b, count);
        if (!is_solid(cap, near, b, p, slack))
            continue;
        const float3 ob = (float3)(near[b], near[NEAR_ROOM + b], near[2 * NEAR_ROOM + b]) - p;
        const float rb = near[3 * NEAR_ROOM + b];
        int kept = b + 1;
        for (int s = kept; s < count; s += VW) {
            const vf ox = VF_LOAD(near + s) - p.x, oy = VF_LOAD(near + NEAR_ROOM + s) - p.y;
            const vf oz = VF_LOAD(near + 2 * NEAR_ROOM + s) - p.z, r = VF_LOAD(near + 3 * NEAR_ROOM + s);
            const vf f = (ox * ob.x + oy * ob.y + oz * ob.z) / (ox * ox + oy * oy + oz * oz);
            const vf x = f * ox - ob.x, y = f * oy - ob.y, z = f * oz - ob.z;
            const vf room = rb * 0.9999f - f * r - fabs(1.0f - f) * slack;
            const vi hidden = (room > 0.0f) & (f > 0.0f) & (x * x + y * y + z * z <= room * room);
            const int n = min(VW, count - s);
            if (kept == s && !some(hidden)) {
                kept += n;
                continue;
            }
            for (uint lanes = lane_bits(hidden == 0) & (0xffffffffu >> (32 - n)); lanes; lanes &= lanes - 1) {
                const int from = s + lowest_bit(lanes);
                for (int k = 0; k < NEAR_ROWS; k++)
                    near[k * NEAR_ROOM + kept] = near[k * NEAR_ROOM + from];
                kept++;
            }
        }
        idle = kept < count ? 0 : idle + 1;
        count = kept;
    }
    return count;
}

/* Fills `near` and `list` for the points of a work-group, whose rows begin at `points`, and for lights from the first on
   while there is room; returns the light after them. */
__attribute__((noinline))
int list_near(const __local blockers_t *blockers, __global const float *points, int stride, __global const light_t *lights,
              int first_light, int n_lights, __local float *near, __local int *list)
{
    if (blockers->n_groups == 0 && n_lights == 1) {
        list[0] = list[1] = 0;
        return 1;
    }
    const bounds_t bounds = bounds_of(points, stride);
    const float3 p = 0.5f * (bounds.low + bounds.high);
    const float slack = 1.0001f * length(bounds.high - p);
    int count = 0;
    for (int j = first_light; j < n_lights; j++) {
        const float3 centre = vload3(0, lights[j].center);
        const float r = lights[j].radius;
        const cap_t cap = cap_of(centre - p, r);
        const int first = count;
        list[2 * j] = first;
        if (is_below(&bounds, centre, r)) {
            list[2 * j + 1] = BELOW;
            continue;
        }
        /* What a point sees of the light is no cone from the middle where that is inside of it or next to it; points
           look at point lights along one direction. */
        if (r == 0.0f || cap.near <= slack || cap.tau < COS2_WIDE * cap.d * cap.d) {
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
            if (count - first >= FEW_NEAR)
                count = drop_hidden(&cap, near, first, count, p, slack);
            list[2 * j + 1] = count - first;
            for (; count % VW; count++)
                near[3 * NEAR_ROOM + count] = -1.0f;
        } else if (first > 0) {
            return j; /* with the whole room next time */
        } else {
            list[2 * j + 1] = ALL_GROUPS;
            count = 0;
        }
    }
    return n_lights;
}
