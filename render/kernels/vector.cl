/* Two families of vectors: `vf` holds VW blockers (culling), `rf` holds RW rows of the mask (splatting).

   VW, ROWS and RW come from the host: ROWS = 2^depth rows and columns, RW = min(VW, ROWS), NR = ROWS / RW. */
#define CAT_(a, b) a##b
#define CAT(a, b) CAT_(a, b)

typedef CAT(float, VW) vf;
typedef CAT(int, VW) vi;
#define VF_LOAD(p) CAT(vload, VW)(0, p)
#define VI_LOAD(p) CAT(vload, VW)(0, p)
#define AS_VI CAT(as_int, VW)
#define VI_STORE(v, p) CAT(vstore, VW)(v, 0, p)
#define VF_STORE(v, p) CAT(vstore, VW)(v, 0, p)

/* One bit per lane of a comparison's result, lane 0 lowest. */
inline uint lane_bits(vi chosen)
{
#if VW == 16
    const int16 bit = (int16)(1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1024, 2048, 4096, 8192, 16384, 32768) & chosen;
    const int8 b8 = bit.lo | bit.hi;
    const int4 b4 = b8.lo | b8.hi;
#elif VW == 8
    const int8 bit = (int8)(1, 2, 4, 8, 16, 32, 64, 128) & chosen;
    const int4 b4 = bit.lo | bit.hi;
#else
    const int4 b4 = (int4)(1, 2, 4, 8) & chosen;
#endif
    const int2 b2 = b4.lo | b4.hi;
    return (uint)(b2.x | b2.y);
}

/* Is the comparison's result true in some lane? */
inline int some(vi chosen)
{
    return lane_bits(chosen) != 0;
}

/* Number of the lowest set bit. */
inline int lowest_bit(uint bits)
{
    return 31 - clz(bits & -bits);
}

typedef CAT(float, RW) rf;
typedef CAT(int, RW) ri;
typedef CAT(uint, RW) ru;
#define RU_LOAD(k, p) CAT(vload, RW)(k, p)
#define RU_STORE(v, k, p) CAT(vstore, RW)(v, k, p)
#define RI_LOAD(p) CAT(vload, RW)(0, p)
#define RI_STORE(v, p) CAT(vstore, RW)(v, 0, p)
#define RF_STORE(v, p) CAT(vstore, RW)(v, 0, p)
#define RF_LOAD(p) CAT(vload, RW)(0, p)
#define TO_RI CAT(convert_int, RW)
#define TO_RF CAT(convert_float, RW)
#define AS_RU CAT(as_uint, RW)
#define AS_RI CAT(as_int, RW)
#define AS_RF CAT(as_float, RW)

inline rf row_numbers(void)
{
#if RW == 16
    return (rf)(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
#elif RW == 8
    return (rf)(0, 1, 2, 3, 4, 5, 6, 7);
#else
    return (rf)(0, 1, 2, 3);
#endif
}

inline float row_sum(rf v)
{
#if RW == 16
    const float8 a = v.lo + v.hi;
    const float4 b = a.lo + a.hi;
#elif RW == 8
    const float4 b = v.lo + v.hi;
#else
    const float4 b = v;
#endif
    const float2 c = b.lo + b.hi;
    return c.x + c.y;
}

/* In how many lanes is the comparison's result true? */
inline int row_bits_count(ri chosen)
{
    return (int)(0.5f - row_sum(TO_RF(chosen)));
}

/* One bit per lane of a comparison's result, lane 0 lowest. */
inline uint row_bits(ri chosen)
{
#if RW == VW
    return lane_bits(chosen);
#else
    int lanes[RW];
    RI_STORE(chosen, lanes);
    uint bits = 0;
    for (int l = 0; l < RW; l++)
        bits |= (lanes[l] & 1) << l;
    return bits;
#endif
}

/* The bits of all lanes. */
inline uint row_or(ru v)
{
#if RW == 16
    const uint8 a = v.lo | v.hi;
    const uint4 b = a.lo | a.hi;
#elif RW == 8
    const uint4 b = v.lo | v.hi;
#else
    const uint4 b = v;
#endif
    const uint2 c = b.lo | b.hi;
    return c.x | c.y;
}
