/* Lobe mathematics on the device. Each function has a float64 twin: coslobe.tables.lobe and coslobe.render.unshadowed.
   Angles in rad, solid angles in sr. */

/* exp(e log(1 - q)) for rows of q >= 0: the lobe from q = |a - v|^2 / 2, without the rounding of a dot product.
   Relative error 1e-6 + 2e-7 |e log(1 - q)|. */
inline rf lobe_rows(rf q, rf e)
{
    return select((rf)(0.0f), exp_rows(e * log_rows(q)), q < 1.0f);
}

/* The same for one direction. */
inline float lobe_value(float q, float e)
{
    return q < 1.0f ? exp(fmax(e * log1p(-q), -80.0f)) : 0.0f;
}

/* Irradiance / radiance of a uniform sphere light that a horizon may cut: Snyder 1996; Lagarde and de Rousiers
   2014. `co` = n.a, `q` = (r / d)^2 < 1. */
inline pf lambert_sphere(pf co, pf q)
{
    const pf whole = M_PI_F * q * fmax(co, 0.0f);
    const pi cut = co * co <= q;
    if (!point_bits(cut))
        return whole;
    const pf st = sqrt(fmax(1.0f - co * co, 1e-12f));
    const pf x = sqrt(fmax(1.0f / q - 1.0f, 0.0f));
    const pf y = clamp(-x * co / st, -1.0f, 1.0f);
    const pf z = st * sqrt(fmax(1.0f - y * y, 0.0f)), hypotenuse = sqrt(x * x + z * z);
    const pf elevation = angle_points(z * z / fmax(hypotenuse * (hypotenuse + x), 1e-30f)); /* atan2(z, x) */
    return select(whole, fmax((co * angle_points(1.0f - y) - x * z) * q + elevation, 0.0f), cut);
}

/* Cosine (returned) and sine of a fraction of a full turn, within 2e-7: least squares over a quarter to either side. */
inline float sincos_turn(float turn, float *sine)
{
    const float x = turn - floor(turn + 0.5f), far = fabs(x) > 0.25f ? -1.0f : 1.0f;
    const float y = far < 0.0f ? copysign(0.5f, x) - x : x, z = y * y; /* sin(pi - a) = sin a, cos(pi - a) = -cos a */
    *sine = y * (6.28318548f + z * (-41.3416824f + z * (81.6024780f + z * (-76.5812607f + z * 39.7604981f))));
    return far * (1.0f + z * (-19.7392082f + z * (64.9393463f + z * (-85.4535675f + z * (60.1439362f - z * 24.9817200f)))));
}
