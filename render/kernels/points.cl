/* Points PW at a time: what every point needs, whether or not anything blocks its light, is computed for as many points
   as vectors have lanes; PW is 1 where the device has none. */

#if PW == 1
#define POINTS(T) T
#else
#define POINTS(T) CAT(T, PW)
#endif

typedef POINTS(float) pf;
typedef POINTS(int) pi;
#define TO_PI POINTS(convert_int)
#define TO_PF POINTS(convert_float)
#define AS_PI POINTS(as_int)
#define AS_PF POINTS(as_float)

/* The value of one point, to be read or written. */
#define LANE(v, l) (((__private float *)&(v))[l])
#define INT_LANE(v, l) (((__private int *)&(v))[l])

typedef struct {
    pf x, y, z;
} pf3;

inline pf dots(pf3 a, pf3 b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

inline pf3 scaled(pf3 v, pf s)
{
    const pf3 r = {v.x * s, v.y * s, v.z * s};
    return r;
}

/* a + s b */
inline pf3 plus(pf3 a, pf s, pf3 b)
{
    const pf3 r = {a.x + s * b.x, a.y + s * b.y, a.z + s * b.z};
    return r;
}

inline pf3 crosses(pf3 a, pf3 b)
{
    const pf3 r = {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
    return r;
}

inline pf largest_of(pf3 v)
{
    return fmax(fmax(v.x, v.y), v.z);
}

inline float3 vector_lane(const pf3 *v, int l)
{
    return (float3)(((__private const float *)&v->x)[l], ((__private const float *)&v->y)[l],
                    ((__private const float *)&v->z)[l]);
}

/* One bit per point of a comparison's result, the first lowest. */
inline uint point_bits(pi chosen)
{
#if PW == 1
    return chosen != 0;
#elif PW == VW
    return lane_bits(chosen);
#else
    uint bits = 0;
    for (int l = 0; l < PW; l++)
        bits |= (INT_LANE(chosen, l) & 1) << l;
    return bits;
#endif
}

inline int point_sum(pi v)
{
    int sum = 0;
    for (int l = 0; l < PW; l++)
        sum += INT_LANE(v, l);
    return sum;
}
