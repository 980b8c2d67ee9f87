// Computes a splat's path across the view while the shutter is open, as a straight line, and the quad of its streak.
// Twin of splatgl/splat/motion.py. All lengths in mean voxel spacings, in eye axes.
// switch MOTION MOTION_OFF  form of motion blur
// switch FLOW 0             splats have velocities of their own
#include "approximations.glsl"
#define MOTION_OFF 0
#define MOTION_EXACT 1
#define MOTION_ENERGY 2
#define MOTION_PAPER 3

#constant NEAREST  // a place nearer to the eye's plane has none in the picture
#constant AHEAD    // nor a kernel that reaches this part of the way to it: it stands still
#constant FAR      // within 7 % all rays that meet a kernel are parallel from this many of its reaches on

// footprints on the quads of Table 1's rows 4 and 5 are stretched there
#define ON_QUADS (PERSPECTIVE && ALIGN != ALIGN_EXACT)

struct Streak {
    vec2 shift;  // from the path's middle in time to its mean position
    vec2 move;   // from its start to its end; both across the view at the middle's depth
};

vec3 eye_point(vec4 columns[3], vec4 eye, vec3 local) {
    return mat3(columns[0].xyz, columns[1].xyz, columns[2].xyz) * local - eye.xyz;
}

// v: the middle in time. By Simpson's rule; zero for a kernel beside the eye.
Streak streak_of(vec3 v, vec3 first, vec3 last) {
    Streak still = Streak(vec2(0.0), vec2(0.0));
    if (PERSPECTIVE == 0) {
        if (v.z <= frame.depth_reach) return still;
        return Streak(((first.xy - v.xy) + (last.xy - v.xy)) / 6.0, last.xy - first.xy);
    }
    if (min(v.z, min(first.z, last.z)) <= NEAREST || v.z <= AHEAD * frame.depth_reach) return still;
    vec2 before = first.xy / first.z - v.xy / v.z;
    vec2 after = last.xy / last.z - v.xy / v.z;
    return Streak((before + after) * (v.z / 6.0), (after - before) * v.z);
}

// Maps offsets across the view to the kernel's own axes, antialiasing included.
struct Inner {
    mat2x3 axes;   // of an offset's x and y, index axes (eye axes for cubes)
    vec2 shrink;   // min(1, σ/p) along the voxel's two axes across the view
};

Inner inner_of(vec3 v, bool widened) {
    float p = widened ? smallest_axis(v.z) : 0.0;
    if (CUBIC == 1) {
        float f = 1.0 / max(1.0, p);
        return Inner(mat2x3(f, 0.0, 0.0, 0.0, f, 0.0), vec2(f));
    }
    Ellipse ellipse = voxel_ellipse(vec3(1.0, 0.0, 0.0), vec3(0.0, 1.0, 0.0));
    vec2 f = min(vec2(1.0), ellipse.width / max(p, 1e-30));
    vec3 first = ellipse.axis_1 * f.x, second = ellipse.axis_2 * f.y;
    return Inner(mat2x3(to_index(first * ellipse.axis_1.x + second * ellipse.axis_2.x),
                        to_index(first * ellipse.axis_1.y + second * ellipse.axis_2.y)), f);
}

// The path's length across its own ray, in the kernel's units.
float length_of(Inner inner, vec3 v, vec2 step_) {
    vec3 line = to_index(vec3(0.0, 0.0, 1.0));
    if (PERSPECTIVE == 1) line += inner.axes * (v.xy / v.z);
    vec3 move = inner.axes * step_;
    return length(move - line * (dot(move, line) / dot(line, line)));
}

// A step across the view as its eye sees it on the plane of a quad, in voxels.
vec2 step_on(Quad quad, vec2 step_) {
    vec3 move = vec3(step_, 0.0);
    return vec2(dot(move, quad.axis_1) / dot(quad.axis_1, quad.axis_1),
                dot(move, quad.axis_2) / dot(quad.axis_2, quad.axis_2));
}

// Reach of a footprint along the unit vector h of the picture, swept by `half_` either way.
float reach_along(vec2 h, vec3 v, Quad quad, bool widened, float half_) {
    if (PERSPECTIVE == 1 && !widened) {
        mat3 rows = transpose(eye_from_index());
        vec3 e = rows[0] * h.x + rows[1] * h.y;
        float x = dot(v.xy, h);
        // far away rays through the kernel are parallel, and the tangents' root would lose its digits
        if (v.z > FAR * frame.depth_reach)
            return style.radius * 1.15 * length(abs(e) + (abs(x) + half_) / v.z * abs(rows[2]));
        vec2 ends = max(tangents(x - half_, v.z, e, rows[2]), tangents(x + half_, v.z, e, rows[2]));
        return v.z * max(ends.x, ends.y);
    }
    return quad.reach * length(vec2(dot(quad.axis_1.xy, h), dot(quad.axis_2.xy, h)));
}

// From the path's middle to one corner of the streak's quad, which is parallel to the image.
vec2 streak_corner(vec2 corner, vec3 v, vec2 step_, Quad quad, bool widened) {
    float half_ = length(step_) * 0.5;
    vec2 h = normalize(step_);
    vec2 n = vec2(-h.y, h.x);
    float along = half_ + reach_along(h, v, quad, widened, half_);
    return h * (corner.x * along) + n * (corner.y * reach_along(n, v, quad, widened, 0.0));
}
