// One splat's contribution to one pixel: its footprint, then the blend mode's value.
#define VARYING in
#define FLAT flat
#include "footprint_eval.glsl"
#include "streak.glsl"

out vec4 fragment;  // linear premultiplied: 'over', sum or maximum, as JOIN says

// Footprint of a still splat, over F(0)·gain.
float footprint() {
    if (HALF_LINE == 1 && center.w > 0.0) return half_line(center.xyz, ray_at(gl_FragCoord.xy));
    float r2 = dot(at, at);
    if (ALIGN == ALIGN_EXACT) return exact_share(at, 1.0 / (1.0 + r2 * max(bend.x, 0.0)), ray_of(gl_FragCoord.xy));
    if (FOOTPRINT != FOOTPRINT_TABLE) return radial(r2);
    // quads are a little larger than the table
    vec2 place = at / style.radius;
    return max(abs(place.x), abs(place.y)) <= 1.0 ? texture(footprint_table, place * 0.5 + 0.5).r : 0.0;
}

// Contribution of a moving splat: opacity, or the sum's term.
float streaked() {
    Passing p = passing(path_center, at, path_step, Inner(mat2x3(inner_x, inner_y), path_isolation.yz));
    float value = splat.a * streak_shape(p);
    if (JOIN == JOIN_OVER && ATTENUATION == ATTENUATION_FILL)
        return dwelt_opacity(value, splat.a * p.gain * stretched(p), path_isolation.x);
    return blended(value);
}

void main() {
    bool moves = MOTION != MOTION_OFF && path_step != vec2(0.0);
    fragment = vec4(splat.rgb, 1.0) * (moves ? streaked() : blended(splat.a * footprint()));
}
