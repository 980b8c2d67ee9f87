// Computes the quad of one splat: its plane and its two axes, with antialiasing.
// Twin of splatgl/splat/footprint.py.  [M98 Table 1 row 4] [M98 Table 1 row 5]
#include "ellipse.glsl"

// All lengths in mean voxel spacings, in eye axes. A point on the quad is r.x axis_1 + r.y axis_2, r in voxels.
struct Quad {
    vec3 axis_1;
    vec3 axis_2;
    float reach;     // |r.x|, |r.y| at the corners: covers the support
    float gain;      // line integral of the splat at its centre over F(0): 1/m² for cubic voxels [M98 Eq. 6]
    float coverage;  // the unstretched footprint's share of the stretched one's area: 1/m²
    // distance terms of approximations.glsl beyond |r|; 0 elsewhere
    vec4 bend;
    vec4 cubic;
    vec4 mixed;
};

// A quad whose distance is |r|.
Quad plain_quad(vec3 axis_1, vec3 axis_2, float gain, float coverage) {
    return Quad(axis_1, axis_2, style.radius, gain, coverage, vec4(0.0), vec4(0.0), vec4(0.0));
}

// The plane the quad lies in: parallel to the image, or perpendicular to the eye–voxel ray.
void quad_plane(vec3 v, out vec3 e1, out vec3 e2) {
    e1 = vec3(1.0, 0.0, 0.0);
    e2 = vec3(0.0, 1.0, 0.0);
    float far = length(v);
    bool rotate = PERSPECTIVE == 1 && ALIGN != ALIGN_GRID && far > 0.0;
    if (ALIGN == ALIGN_HYBRID) rotate = rotate && v.z < frame.switch_depth;
    if (rotate) perpendicular_axes(v / far, e1, e2);
}

// v: the voxel's centre.  Stretch m = max(1, p/s) [M98 Eq. 4], separately along each axis of a non-cubic voxel.
Quad table_quad(vec3 v) {
    vec3 e1, e2;
    quad_plane(v, e1, e2);
    float p = smallest_axis(v.z) / splat_size;
    if (CUBIC == 1) {
        float m = max(1.0, p);
        return plain_quad(e1 * m, e2 * m, 1.0 / (m * m), 1.0 / (m * m));
    }
    Ellipse ellipse = voxel_ellipse(e1, e2);
    vec2 g = max(ellipse.width, vec2(p));
    float area = g.x * g.y;
    return plain_quad(ellipse.axis_1 * g.x, ellipse.axis_2 * g.y, 1.0 / area,
                      ellipse.width.x * ellipse.width.y / area);
}
