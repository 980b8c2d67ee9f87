// Places one corner of a splat's quad relative to the eye: rotated, stretched and shaded. Instances are splats in drawing
// order, each a triangle strip of four vertices.
#define VARYING out
#define FLAT flat
#include "splat_setup.glsl"
#include "sheets.glsl"
#constant PIXEL_MARGIN     // see widened_corner
#constant HALF_LINE_REACH  // a kernel whose centre is nearer than the root of this many R is around the eye

in uvec4 in_first;          // words of the record
in uvec4 in_second;
in uvec2 in_rest;
in vec3 in_flow;            // motion: grid steps in half of the exposure
uniform int sheet;          // the first of the sheets that share it

out vec3 corner_eye;        // for tests: the corner in eye axes, mean spacings
out float gain;

// Clip coordinates of a point in eye axes. No depth test: z only clips what is nearer than `near`.
vec4 clip_from_eye(vec3 point) {
    if (PERSPECTIVE == 1) return vec4(point.xy * frame.clip_scale, point.z - 2.0 * frame.near, point.z);
    return vec4(point.xy * frame.clip_scale, 0.0, 1.0);
}

// Rasterisers snap corners to 1/256 of a pixel: quads are enlarged slightly so that no pixel is lost.
vec2 widened_corner(vec2 corner, vec3 v, Quad quad) {
    vec2 sides = vec2(length(quad.axis_1), length(quad.axis_2)) * quad.reach;
    return corner * (1.0 + PIXEL_MARGIN * pixel_side(v.z) / max(sides, vec2(1e-30)));
}

// Gives quad_place the map from pixels to the coordinates on a plane through v.
void give_place(vec3 v, vec3 axis_1, vec3 axis_2) {
    vec3 pole = PERSPECTIVE == 1 ? v : vec3(0.0, 0.0, 1.0);
    place_middle = v;
    place_normal = cross(axis_1, axis_2);
    place_row_1 = cross(axis_2, pole);
    place_row_2 = cross(pole, axis_1);
}

void main() {
    read_words(in_first, in_second, in_rest);
    // relative to the eye before any rounding
    vec3 local = in_position - frame.base.xyz, before = local, after = local;
    if (FLOW == 1) {
        // the record's position is that at shutter close
        local -= in_flow;
        before = local - in_flow;
    }
    vec3 v = eye_from_index() * local - frame.eye_from_base.xyz;
    Streak streak = Streak(vec2(0.0), vec2(0.0));
    if (MOTION != MOTION_OFF)
        streak = streak_of(v, eye_point(frame.first_from_index, frame.first_from_base, before),
                           eye_point(frame.last_from_index, frame.last_from_base, after));
    v.xy += streak.shift;

    // the corner, and its footprint coordinates
    Quad quad = splat_quad(v);
    quad.axis_1 *= splat_size;
    quad.axis_2 *= splat_size;
    vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 2.0 - 1.0;
    corner = widened_corner(corner, v, quad);
    at = corner * quad.reach;
    vec3 point = v + at.x * quad.axis_1 + at.y * quad.axis_2;
    give_place(v, quad.axis_1, quad.axis_2);
    give_matter(v, quad);
    if (SHEETS > 0) sheet_shares = sheet_weights(sheet_place(in_position) - float(sheet));

    path_center = v;
    path_step = streak.move;
    path_isolation = inner_x = inner_y = vec3(0.0);
    if (path_step != vec2(0.0)) {
#if ON_QUADS
        path_step = step_on(quad, streak.move);
        float size = length(path_step);
        vec2 heading = path_step / max(size, 1e-18);
        at = mat2(heading, -heading.y, heading.x) * (corner * vec2(quad.reach + 0.5 * size, quad.reach));
        point = v + at.x * quad.axis_1 + at.y * quad.axis_2;
        vec2 shrink = vec2(0.0);
#else
        bool widened = PERSPECTIVE == 0 || is_widened(v);
        Inner inner = inner_of(v, widened);
        inner_x = inner.axes[0];
        inner_y = inner.axes[1];
        at = streak_corner(corner, v, path_step, quad, widened);
        point = v + vec3(at, 0.0);
        give_place(v, vec3(1.0, 0.0, 0.0), vec3(0.0, 1.0, 0.0));
        float size = length_of(inner, v, path_step);
        vec2 shrink = inner.shrink;
        if (PEAK == 0) splat.a = attenuated_depth(v, quad.coverage) * style.peak;
#endif
        float alone = isolation(size, run_along(index_from_eye() * vec3(streak.move, 0.0), in_runs));
        path_isolation = vec3(ATTENUATION == ATTENUATION_FILL ? alone : 0.0, shrink);
        coverage /= 1.0 + size * frame.line;
    }
    corner_eye = point;
    gain = quad.gain;

    bool seen = PERSPECTIVE == 1 || MOTION == MOTION_OFF || v.z >= 0.0;
    gl_Position = seen ? clip_from_eye(point) : vec4(0.0, 0.0, 2.0, 1.0);
    center = vec4(to_index(v), 0.0);
    if (HALF_LINE == 1 && !is_widened(v) && dot(center.xyz, center.xyz) < HALF_LINE_REACH * style.radius * style.radius) {
        // a kernel around the eye may cover any pixel
        center.w = 1.0;
        gl_Position = vec4(corner, 0.0, 1.0);
    }
    if (BOXES == 1) center.xyz = local;
}
