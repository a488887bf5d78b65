/* Points of a picture from what its rays hit, one work-item per hit of one object, in double precision: the device's
   twin of `resolve` in gbuffer.py. A hit that another object hides is left alone. */
#pragma OPENCL EXTENSION cl_khr_fp64 : enable

typedef struct {
    int row, column;
} pixel_t;

inline pixel_t pixel_at(const uint place)
{
    const pixel_t pixel = {place >> 16, place & 0xffff};
    return pixel;
}

/* A ray's direction, not of unit length. The camera: vectors from the picture's upper left corner, along a pixel to the
   right and down, and to that corner; origin; sample positions. */
inline double3 along_ray(const pixel_t pixel, const int sample, __constant double *camera)
{
    const double x = pixel.column + camera[12 + 2 * sample], y = pixel.row + camera[13 + 2 * sample];
    return x * vload3(0, camera) + y * vload3(1, camera) + vload3(2, camera);
}

/* Points are rows of `stride` numbers; the last point is repeated to fill its work-group. */
inline void write_point(__global float *points, const int n_points, const int stride, const int i,
                        const double3 position, const float3 geometric, const float3 shading, const int material,
                        const int object, const pixel_t pixel)
{
    const double noise = 0.06711056 * pixel.column + 0.00583715 * pixel.row;
    const double turn = 52.9829189 * (noise - floor(noise));
    const int last = i == n_points - 1 ? stride - 1 : i;
    for (int k = i; k <= last; k++) {
        points[POSITION_X * stride + k] = (float)position.x;
        points[POSITION_Y * stride + k] = (float)position.y;
        points[POSITION_Z * stride + k] = (float)position.z;
        points[GEOMETRIC_X * stride + k] = geometric.x;
        points[GEOMETRIC_Y * stride + k] = geometric.y;
        points[GEOMETRIC_Z * stride + k] = geometric.z;
        points[SHADING_X * stride + k] = shading.x;
        points[SHADING_Y * stride + k] = shading.y;
        points[SHADING_Z * stride + k] = shading.z;
        points[TURN * stride + k] = (float)(turn - floor(turn));
        points[MATERIAL * stride + k] = as_float(material);
        points[OBJECT * stride + k] = as_float(object);
    }
}

/* What both kernels need: the hits of an object by their rays; of each ray its pixel, the nearest object and its point. */
#define HIT_ARGUMENTS                                                                                                  \
    const int n, __global const int *rays, __global const uint *pixels, __global const int *objects,                  \
        __global const int *number, const int complete, const int object, const int samples,                           \
        __constant double *camera, __global const int *material, __global float *points, const int n_points,           \
        const int stride

#define HIT_OF_THIS_ITEM                                                                                               \
    const int e = get_global_id(0);                                                                                    \
    if (e >= n || objects[rays[e]] != object)                                                                          \
        return;                                                                                                        \
    const int ray = rays[e], i = complete ? ray : number[ray];                                                         \
    const pixel_t pixel = pixel_at(pixels[ray]);                                                                       \
    const double3 along = along_ray(pixel, samples == 1 ? 0 : ray % samples, camera);

/* `placing` is the object's matrix by rows of four, with its translation relative to the points' origin, and the inverse
   of its linear part by rows. */
__kernel void points_on_mesh(HIT_ARGUMENTS, __constant double *placing, __global const int *triangle,
                             __global const float *uv, __global const int *faces, __global const double *vertices,
                             __global const double *normals, const int flat)
{
    HIT_OF_THIS_ITEM
    const int3 corner = vload3(triangle[e], faces);
    const double3 a = vload3(corner.x, vertices), b = vload3(corner.y, vertices), c = vload3(corner.z, vertices);
    const double u = uv[2 * e], v = uv[2 * e + 1], w = 1.0 - u - v;
    const double3 place = w * a + u * b + v * c;
    double3 g = cross(b - a, c - a);
    double3 s = w * vload3(corner.x, normals) + u * vload3(corner.y, normals) + v * vload3(corner.z, normals);
    if (flat || dot(s, s) <= 1e-12)
        s = g;
    const double3 x = vload3(4, placing), y = vload3(5, placing), z = vload3(6, placing);
    g = g.x * x + g.y * y + g.z * z;
    s = s.x * x + s.y * y + s.z * z;
    g *= dot(g, along) > 0.0 ? -rsqrt(dot(g, g)) : rsqrt(dot(g, g));
    s *= dot(s, g) < 0.0 ? -rsqrt(dot(s, s)) : rsqrt(dot(s, s));
    const double3 position = {dot(vload4(0, placing).xyz, place) + placing[3],
                              dot(vload4(1, placing).xyz, place) + placing[7],
                              dot(vload4(2, placing).xyz, place) + placing[11]};
    write_point(points, n_points, stride, i, position, convert_float3(g), convert_float3(s), material[i], object, pixel);
}

/* `normal` is on the viewer's side. */
__kernel void points_on_plane(HIT_ARGUMENTS, const float4 normal, __global const double *t)
{
    HIT_OF_THIS_ITEM
    const double3 position = vload3(3, camera) + t[e] * rsqrt(dot(along, along)) * along;
    write_point(points, n_points, stride, i, position, normal.xyz, normal.xyz, material[i], object, pixel);
}
