// One splat, placed relative to the eye, rotated, stretched, shaded: as a sprite, which is one vertex in drawing order,
// or one corner of its quad, where instances are splats in drawing order and a triangle strip has four vertices.
// switch FEEDBACK 0
#define ATTRIBUTE in
#define VARYING out
#define FLAT flat
#include "placing.glsl"
#include "hidden.glsl"

#if FLOW
in vec3 in_flow;            // grid steps in half of the exposure
#endif

#if FEEDBACK
out vec3 corner_eye;        // the corner in eye axes, mean spacings
out float gain;
#endif

// Clip coordinates of a point in eye axes. No depth test: z only clips what is nearer than `near`.
vec4 clip_from_eye(vec3 point) {
#if PERSPECTIVE
    return vec4(point.xy * frame.clip_scale, point.z - 2.0 * frame.near, point.z);
#else
    return vec4(point.xy * frame.clip_scale, 0.0, 1.0);
#endif
}

// A rasteriser snaps corners to 1/256 of a pixel: a quad is larger by a little, so that none is lost in between.
vec2 widened_corner(vec2 corner, vec3 v, vec2 sides) {
#if PERSPECTIVE
    float pixel_side = frame.pixel_pitch * max(v.z, 0.0);
#else
    float pixel_side = frame.pixel_pitch;
#endif
    return corner * (1.0 + SPRITE_MARGIN * pixel_side / max(sides, vec2(1e-30)));
}

void main() {
    // relative to the eye before anything is rounded
    vec3 local = in_position - frame.base.xyz;
#if MOTION != MOTION_OFF
    vec3 before = local, after = local;
#if FLOW
    // it is in its own place when the shutter closes
    local -= in_flow;
    before = local - in_flow;
#endif
#endif
    vec3 v = eye_from_index() * local - frame.eye_from_base.xyz;
    bool seen = true;
#if MOTION != MOTION_OFF
    Streak streak = streak_of(v, place(path.first_from_index, path.first_from_base, before),
                              place(path.last_from_index, path.last_from_base, after));
    v.xy += streak.shift;
#endif
#if SPRITE
    // the square of pixels, and how they lie in the footprint
    vec3 point = v;
    Sprite sprite;
    PLANE quad = place_sprite(v, sprite, seen);
    gl_PointSize = sprite.size;
#if HIDING
    seen = seen && !is_hidden(sprite.center);
#endif
#else
    // the corner, and where it lies in the footprint
    vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 2.0 - 1.0;
#if ALIGN == ALIGN_EXACT || ALIGN == ALIGN_B1
#if ALIGN == ALIGN_B1
    seen = v.z > frame.near;
    ExactQuad quad = exact_quad(v, true);
    const float across = 1.0;
#else
    bool stretched = is_stretched(v);
    ExactQuad quad = exact_quad(v, stretched);
    float across = quad.reach;
    bend = quad.bend;
#if ANTIALIAS && !CUBIC
    cubic = quad.cubic;
    mixed = quad.mixed;
#endif
#endif
    corner = widened_corner(corner, v, vec2(length(quad.axis_1), length(quad.axis_2)) * quad.reach);
    at = corner * across;
    vec3 point = v + quad.reach * (corner.x * quad.axis_1 + corner.y * quad.axis_2);
#else
    Quad quad = splat_quad(v);
    corner = widened_corner(corner, v, vec2(length(quad.axis_1), length(quad.axis_2)) * style.radius);
    at = corner;
    vec3 point = v + style.radius * (corner.x * quad.axis_1 + corner.y * quad.axis_2);
#if !PERSPECTIVE && MOTION != MOTION_OFF
    seen = v.z >= 0.0;
#endif
#endif
#endif
#if MOTION != MOTION_OFF
    move = streak.step;
    heart = v;
#if PERSPECTIVE
    bool widened = is_stretched(v);
    float reach = quad.reach;
#else
    const bool widened = true;
    float reach = style.radius;
#endif
    Inner inner = inner_of(v, widened);
    shrink = inner.shrink;
#if !CUBIC
    inner_x = inner.axes[0];
    inner_y = inner.axes[1];
#endif
    float size = 0.0;
    if (move != vec2(0.0)) {
        at = streak_corner(corner, v, move, quad.axis_1, quad.axis_2, reach, widened);
        point = v + vec3(at, 0.0);
        size = length_of(inner, v, move);
    }
#endif
    gl_Position = seen ? clip_from_eye(point) : vec4(0.0, 0.0, 2.0, 1.0);
#if HALF_LINE
    // a kernel around the eye may be seen by any pixel
    center = vec4(to_index(v), 0.0);
    if (!stretched && dot(center.xyz, center.xyz) < HALF_LINE_REACH * style.radius * style.radius) {
        center.w = 1.0;
        gl_Position = vec4(corner, 0.0, 1.0);
    }
#endif

    give_matter(v, quad);
#if MOTION != MOTION_OFF
    if (move != vec2(0.0)) {
#if BLEND != BLEND_MIP
        splat.a = attenuated_depth(v, quad.coverage) * style.peak;
#endif
#if ATTENUATION == ATTENUATION_FILL
        lone = alone(size, run_along(index_from_eye() * vec3(move, 0.0), in_runs));
#endif
    }
#if ATTENUATION == ATTENUATION_OPACITY
    coverage /= 1.0 + size * path.line;
#endif
#endif
#if FEEDBACK
    corner_eye = point;
    gain = quad.gain;
#endif
}
