/* Elementary functions of vectors, of rows of a mask (`_rows`) and of points (`_points`). Own polynomials, because runtimes
   compute exp, log and acos lane by lane or with more digits than needed. */

/* NAME(x) for positive x within 1e-7 relative, or 1e-7 absolute near x = 1. */
#define LOGARITHM(NAME, T, I, TO_T, AS_T, AS_I) \
    inline T NAME(T x) \
    { \
        const I raw = AS_I(x); \
        const I exponent = (raw - 0x3f3504f3) >> 23; /* x = m 2^exponent with m in [sqrt(1/2), sqrt(2)) */ \
        const T m = AS_T(raw - (exponent << 23)); \
        const T s = (m - 1.0f) / (m + 1.0f); \
        const T z = s * s; \
        const T atanh2 = 2.0f * s * (1.0f + z * (1.0f / 3 + z * (1.0f / 5 + z * (1.0f / 7 + z * (1.0f / 9))))); \
        return atanh2 + TO_T(exponent) * 0.693147180559945f; \
    }
LOGARITHM(ln_rows, rf, ri, TO_RF, AS_RF, AS_RI)
LOGARITHM(ln_points, pf, pi, TO_PF, AS_PF, AS_PI)

/* log(1 - q) for q in [0, 1), with what rounding takes from 1 - q. */
#define LOG_BELOW(NAME, LN, T) \
    inline T NAME(T q) \
    { \
        const T x = fmax(1.0f - q, 1e-30f); \
        return LN(x) - (q - (1.0f - x)) / x; \
    }
LOG_BELOW(log_rows, ln_rows, rf)
LOG_BELOW(log_points, ln_points, pf)

/* exp(y) for y <= 80 within 1e-7 (1 + |y|) relative; 0 below -88. Adding 1.5 2^23 rounds to a whole number, and leaves it
   in the lowest bits. */
#define EXPONENTIAL(NAME, T, AS_T, AS_I) \
    inline T NAME(T y) \
    { \
        const T t = fmax(y * 1.44269504088896f, -127.0f); \
        const T whole = t + 12582912.0f, f = t - (whole - 12582912.0f); \
        const T p = 1.0f + f * (0.693147004f + f * (0.240222424f + f * (0.0555073358f \
                  + f * (0.00967151299f + f * 0.00132647261f)))); \
        return p * AS_T((AS_I(whole) + 127) << 23); \
    }
EXPONENTIAL(exp_rows, rf, AS_RF, AS_RI)
EXPONENTIAL(exp_points, pf, AS_PF, AS_PI)

/* acos(1 - q) for q in [0, 2]; Abramowitz and Stegun 4.4.46. */
#define ANGLE(NAME, T) \
    inline T NAME(T q) \
    { \
        const T c = fabs(1.0f - q); \
        const T p = 1.5707963050f + c * (-0.2145988016f + c * (0.0889789874f + c * (-0.0501743046f \
                  + c * (0.0308918810f + c * (-0.0170881256f + c * (0.0066700901f - c * 0.0012624911f)))))); \
        const T acute = sqrt(fmax(fmin(q, 2.0f - q), 0.0f)) * p; \
        return select(acute, M_PI_F - acute, q > 1.0f); \
    }
ANGLE(angle_rows, rf)
ANGLE(angle_points, pf)
