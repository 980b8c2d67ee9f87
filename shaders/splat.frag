// Draws one splat in one pixel: its footprint, then the blend mode's value, or the sums that it adds to sheets.
// switch SHEETS 0  sheets that share a splat; 0: splats composite one by one
// switch STEPS 0   parts of a sheet that are classified; 0: splats are classified before
// switch BOXES 0   splats are boxes of voxels, see boxes.glsl
// switch QUANTIZED 0  splats are those of a web page
// switch SLOTTED 0  the matter of boxes is kept for layers_join.frag
#define VARYING in
#define FLAT flat
#include "footprint_eval.glsl"
#include "streak.glsl"
#if BOXES
#include "boxes.glsl"
#endif

#if SHEETS
// of the sheets that share the splat: emission and extinction; with STEPS gradient and value, by mass
layout(location = 0) out vec4 sums[SHEETS];
#if STEPS
layout(location = SHEETS) out float masses[SHEETS];
#endif
#elif SLOTTED
#include "layer_slots.glsl"
uniform ivec2 corner;  // the target's place of the picture's first pixel
uniform vec3 octant;   // signs of the direction of the rays whose matter is kept
out uvec4 piece;
#else
out vec4 fragment;  // linear premultiplied: 'over', sum or maximum, as JOIN says
#endif

// Coordinates of a pixel on the quad, as exact interpolation would give them.
vec2 quad_place(vec2 pixel) {
    vec3 ray = ray_at(pixel);
    // from the quad's middle to the ray's nearest point; where the quad lies beside the eye, its depth is 0
    float along = PERSPECTIVE == 1 ? dot(place_middle, ray) / dot(ray, ray) : 1.0;
    vec3 offset = along * ray - place_middle;
    float divisor = PERSPECTIVE == 1 ? along * dot(place_normal, ray) : place_normal.z;
    return vec2(dot(place_row_1, offset), dot(place_row_2, offset)) / divisor;
}

// Footprint of a still splat, over F(0)·gain.
float footprint() {
    if (HALF_LINE == 1 && center.w > 0.0) return half_line(center.xyz, ray_at(gl_FragCoord.xy));
    float r2 = dot(at, at);
    if (ALIGN == ALIGN_EXACT) return exact_share(at, 1.0 / (1.0 + r2 * max(bend.x, 0.0)), ray_of(gl_FragCoord.xy));
    if (FOOTPRINT != FOOTPRINT_TABLE) return radial(r2);
    // quads are a little larger than the table
    vec2 place = at / style.radius;
    return max(abs(place.x), abs(place.y)) <= 1.0 ? filtered(footprint_table, place * 0.5 + 0.5) : 0.0;
}

#if SLOTTED
// Matter of the box of a voxel along a ray in the octant.
uvec4 boxed_piece() {
    BoxRay ray = box_ray(gl_FragCoord.xy - vec2(corner));
    vec2 ends = box_ends(ray, center.xyz);
    if (ends.y <= ends.x || signs_of(ray.direction) != octant) discard;
    float speed = length(ray.direction);
    float offset = PERSPECTIVE == 1 ? 0.0 : dot(ray.start - box_eye, ray.direction) / speed;
    vec2 shone = box_light(ray, ends);
    vec4 matter = vec4(splat.rgb * shone.x + shone.y, 1.0) * (splat.a * (ends.y - ends.x) * ray.stretch);
    if (matter.a < LEAST_DEPTH) discard;
    return packed_piece(ends * speed + offset, matter, style.brightest);
}
#elif BOXES
// Contribution of the box of a voxel.
vec4 boxed() {
    BoxRay ray = box_ray(gl_FragCoord.xy);
    vec2 ends = box_ends(ray, center.xyz);
    if (ends.y <= ends.x) discard;
    vec2 shone = IN_ORDER ? box_light(ray, ends) : vec2(1.0, 0.0);
    float depth = splat.a * joined_length((ends.y - ends.x) * ray.stretch);
    return vec4(splat.rgb * shone.x + shone.y, 1.0) * (IN_ORDER ? one_minus_exp(depth) : depth);
}
#endif

// Weight of a page's splat in a maximum: 1 around its middle, so that a ray between voxels is no darker.
float weighed(float share) {
    return QUANTIZED == 1 && PEAK == 1 ? clamp(2.5 * share - 0.3, 0.0, 1.0) : share;
}

// Contribution of a moving splat: opacity, or the sum's term.
float streaked() {
#if ON_QUADS
    Passing p = passing_on_quad(at, path_step);
#else
    Passing p = passing(path_center, at, path_step, Inner(mat2x3(inner_x, inner_y), path_isolation.yz));
#endif
    float value = splat.a * streak_shape(p);
    if (IN_ORDER && ATTENUATION == ATTENUATION_FILL)
        return dwelt_opacity(value, splat.a * p.gain * stretched(p), path_isolation.x);
    return blended(value);
}

void main() {
#if PLACED
    at = quad_place(gl_FragCoord.xy);
#endif
#if SHEETS
    float share = footprint();
    vec4 term = STEPS == 0 ? splat.a * vec4(splat.rgb, 1.0) : splat;
    for (int n = 0; n < SHEETS; n++) {
        sums[n] = share * sheet_shares[n] * term;
#if STEPS
        masses[n] = share * sheet_shares[n];
#endif
    }
#elif SLOTTED
    piece = boxed_piece();
#elif BOXES
    fragment = boxed();
#else
    bool moves = MOTION != MOTION_OFF && path_step != vec2(0.0);
    fragment = vec4(splat.rgb, 1.0) * (moves ? streaked() : blended(splat.a * weighed(footprint())));
#endif
}
