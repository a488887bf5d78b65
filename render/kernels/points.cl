/* Points PW at a time: what every point needs, whether or not anything blocks its light, is computed for as many points
   as vectors have lanes. PW is VW, or 1 on devices whose lanes are work-items. */

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

/* Vectors in memory, and the value of one point, to be read or written. */
#if PW == 1
#define PF_LOAD(p) (*(p))
#define LANE(v, l) (v)
#define INT_LANE(v, l) (v)
#else
#define PF_LOAD(p) CAT(vload, PW)(0, p)
#define LANE(v, l) (((__private float *)&(v))[l])
#define INT_LANE(v, l) (((__private int *)&(v))[l])
#endif

typedef struct {
    pf x, y, z;
} pf3;

/* Three rows of numbers. */
inline pf3 load3(__global const float *rows, int stride)
{
    const pf3 v = {PF_LOAD(rows), PF_LOAD(rows + stride), PF_LOAD(rows + 2 * stride)};
    return v;
}

inline pf3 vectors(float x, float y, float z)
{
    const pf3 v = {x, y, z};
    return v;
}

inline pf3 choose(pf3 a, pf3 b, pi second)
{
    const pf3 r = {select(a.x, b.x, second), select(a.y, b.y, second), select(a.z, b.z, second)};
    return r;
}

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
    return (float3)(LANE(v->x, l), LANE(v->y, l), LANE(v->z, l));
}

/* One bit per point of a comparison's result, the first lowest. */
inline uint point_bits(pi chosen)
{
#if PW == 1
    return chosen != 0;
#else
    return lane_bits(chosen);
#endif
}

/* 1 where a comparison's result is true: scalars have that already, vectors -1. */
inline pi ones(pi chosen)
{
    return PW == 1 ? chosen : -chosen;
}

inline pi point_numbers(void)
{
#if PW == 16
    return (pi)(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
#elif PW == 8
    return (pi)(0, 1, 2, 3, 4, 5, 6, 7);
#elif PW == 4
    return (pi)(0, 1, 2, 3);
#else
    return 0;
#endif
}

inline int point_sum(pi v)
{
    int sum = 0;
    for (int l = 0; l < PW; l++)
        sum += INT_LANE(v, l);
    return sum;
}

/* A table of `count` columns, one row of numbers after another. */
typedef struct {
    __global const float *rows;
    int count;
} table_t;

/* How the columns that points need lie: all points need one, or they lie side by side, or anyhow. */
enum { ONE_COLUMN, NEIGHBOURS, SCATTERED };

inline int kind_of(pi columns)
{
#if PW == 1
    return ONE_COLUMN;
#else
    const pi from_first = columns - INT_LANE(columns, 0);
    if (!point_bits(from_first != 0))
        return ONE_COLUMN;
    return point_bits(from_first != point_numbers()) ? SCATTERED : NEIGHBOURS;
#endif
}

/* One row at each point's column. */
inline pf look_up(const __local table_t *table, int row, pi columns, int kind)
{
    __global const float *numbers = table->rows + row * table->count;
    if (kind == ONE_COLUMN)
        return numbers[INT_LANE(columns, 0)];
    if (kind == NEIGHBOURS)
        return PF_LOAD(numbers + INT_LANE(columns, 0));
    pf found;
    for (int l = 0; l < PW; l++)
        LANE(found, l) = numbers[INT_LANE(columns, l)];
    return found;
}

inline pf3 look_up3(const __local table_t *table, int row, pi columns, int kind)
{
    const pf3 v = {look_up(table, row, columns, kind), look_up(table, row + 1, columns, kind),
                   look_up(table, row + 2, columns, kind)};
    return v;
}

/* The four columns of a table that has a row of four numbers for each point. */
inline void columns_of(const float4 *rows, pf *columns)
{
#if PW == 1
    columns[0] = rows[0].x;
    columns[1] = rows[0].y;
    columns[2] = rows[0].z;
    columns[3] = rows[0].w;
#else
    const float *numbers = (const float *)rows;
    const pf a = PF_LOAD(numbers), b = PF_LOAD(numbers + PW), c = PF_LOAD(numbers + 2 * PW), d = PF_LOAD(numbers + 3 * PW);
    const pf even1 = (pf)(a.even, b.even), even2 = (pf)(c.even, d.even);
    const pf odd1 = (pf)(a.odd, b.odd), odd2 = (pf)(c.odd, d.odd);
    columns[0] = (pf)(even1.even, even2.even);
    columns[1] = (pf)(odd1.even, odd2.even);
    columns[2] = (pf)(even1.odd, even2.odd);
    columns[3] = (pf)(odd1.odd, odd2.odd);
#endif
}

/* Stores vectors one after another, as rows of four numbers whose last the next one overwrites. */
inline void store3(pf3 v, __global float *out)
{
#if PW == 1
    vstore3((float3)(v.x, v.y, v.z), 0, out);
#else
    pf xz1, xz2, y1 = 0.0f, y2 = 0.0f;
    xz1.even = v.x.lo;
    xz1.odd = v.z.lo;
    xz2.even = v.x.hi;
    xz2.odd = v.z.hi;
    y1.even = v.y.lo;
    y2.even = v.y.hi;
    pf rows[4];
    rows[0].even = xz1.lo;
    rows[0].odd = y1.lo;
    rows[1].even = xz1.hi;
    rows[1].odd = y1.hi;
    rows[2].even = xz2.lo;
    rows[2].odd = y2.lo;
    rows[3].even = xz2.hi;
    rows[3].odd = y2.hi;
    const float4 *points = (const float4 *)rows;
    for (int l = 0; l < PW - 1; l++)
        vstore4(points[l], 0, out + 3 * l);
    vstore3(points[PW - 1].xyz, 0, out + 3 * (PW - 1));
#endif
}
