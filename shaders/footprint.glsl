// The quad of one splat: its plane, its two half axes and what antialiasing does to them.
// Twin of splatgl/splat/footprint.py, rows 4 and 5.  [M98 Table 1 row 4] [M98 Table 1 row 5]
#include "ellipse.glsl"

// All lengths in mean voxel spacings, in eye axes.
struct Quad {
    vec3 axis_1;     // half extents of the kernel's unit radius across the plane
    vec3 axis_2;
    float gain;      // line integral of the splat at its centre over F(0): 1/m² for cubic voxels [M98 Eq. 6]
    float coverage;  // share of the stretched footprint that the unstretched one would fill: 1/m²
};

// The plane the quad lies in: parallel to the image, or perpendicular to the eye–voxel ray.
void quad_plane(vec3 v, out vec3 e1, out vec3 e2) {
    e1 = vec3(1.0, 0.0, 0.0);
    e2 = vec3(0.0, 1.0, 0.0);
#if PERSPECTIVE && ALIGN != ALIGN_GRID
    float far = length(v);
    bool rotate = far > 0.0;
#if ALIGN == ALIGN_HYBRID
    rotate = rotate && v.z < frame.switch_depth;
#endif
    if (rotate) perpendicular_axes(v / far, e1, e2);
#endif
}

// v: the voxel's centre.  Stretch m = max(1, p/s) [M98 Eq. 4], along each axis of a non-cubic voxel by itself.
Quad splat_quad(vec3 v) {
    vec3 e1, e2;
    quad_plane(v, e1, e2);
    float p = smallest_axis(v.z);
#if CUBIC
    float g = max(1.0, p);
#if ALIGN == ALIGN_A
    // elliptic: the radial axis × q_v cos θ_v, the gain × sec θ_v / q_v, so that the sum over many splats is right
    float out_2 = dot(v.xy, v.xy);
    if (g > 1.0 && out_2 > 0.0) {
        float far = length(v);
        float squeeze = sqrt(1.0 + out_2 / (v.z * v.z * g * g)) * v.z / far;
        vec3 across = vec3(-v.y, v.x, 0.0) * inversesqrt(out_2);
        vec3 radial = cross(across, v / far);
        return Quad(radial * (g * squeeze), across * g, 1.0 / (g * g * squeeze), 1.0 / (g * g));
    }
#endif
    return Quad(e1 * g, e2 * g, 1.0 / (g * g), 1.0 / (g * g));
#else
    Ellipse ellipse = voxel_ellipse(e1, e2);
    vec2 g = max(ellipse.width, vec2(p));
    return Quad(ellipse.axis_1 * g.x, ellipse.axis_2 * g.y, 1.0 / (g.x * g.y),
                ellipse.width.x * ellipse.width.y / (g.x * g.y));
#endif
}
