// Composites a complete sheet behind the light of nearer sheets, or joins its values to theirs, or keeps the matter of one
// of its parts.
#define VARYING
#define FLAT
#define ROWS 1
#define STRIDE 1.0
#include "footprint_eval.glsl"
vec2 first;  // the pixel's centre in its band
#include "sheet_composite.glsl"
#if PIECE
#include "layer_slots.glsl"
uniform int part_;               // number of the part that is kept
out uvec4 piece;
#else
// linear premultiplied, for 'over' from the front to the back; of one value: it, or for a mean the sum by length, and
// the length; for a minimum −value, as blending takes the maximum of both, and of alpha, the optical depth of an
// attenuated maximum, the sum
out vec4 fragment;
uniform sampler2D joined_before; // of an attenuated maximum: what nearer sheets were joined to
#endif

uniform sampler2D sheet_sums;    // of the sheet
uniform sampler2D sheet_masses;
uniform sampler2D sums_before;   // of the sheet before
uniform sampler2D masses_before;
uniform sampler2D sums_earlier;  // of the one before that
uniform sampler2D masses_earlier;
uniform int sheet;               // its number
uniform ivec2 corner;            // the target's place of the first pixel of the band whose sheets these are

void main() {
    first = gl_FragCoord.xy - vec2(corner);
    ivec2 pixel = ivec2(first);
    sum0[0] = texelFetch(sheet_sums, pixel, 0);
    light[0] = vec4(0.0);
    if (STEPS == 0) {
        if (sum0[0].a <= 0.0) discard;
        if (LIMITED == 1) set_ray(0);
    } else {
        masses[0] = texelFetch(sheet_masses, pixel, 0);
        held[0] = vec3(0.0, texelFetch(masses_earlier, pixel, 0).r, texelFetch(masses_before, pixel, 0).r);
        middle[0] = texelFetch(sums_earlier, pixel, 0);
        before[0] = texelFetch(sums_before, pixel, 0);
        take_plane(first, sheet - 2, middle[0], held[0].y);
        take_plane(first, sheet - 1, before[0], held[0].z);
        take_plane(first, sheet, sum0[0], masses[0].x);
        if (masses[0].x + held[0].y + held[0].z < LEAST_MASS) discard;
        set_ray(0);
        middle[0] = centered(0, sheet - 2, middle[0], held[0].y, spread[0].y);
        before[0] = centered(0, sheet - 1, before[0], held[0].z, spread[0].z);
    }
    take_sheet(0, sheet);
#if PIECE
    own_part = part_;
    close_sheet(0, sheet);
    if (kept_matter.a < LEAST_DEPTH) discard;
    piece = packed_piece(kept_ends, kept_matter, style.brightest);
#else
    if (JOIN == JOIN_ATTENUATED) light[0].a = texelFetch(joined_before, ivec2(gl_FragCoord.xy), 0).a;
    float depth_before = light[0].a;
    close_sheet(0, sheet);
    fragment = light[0];
    if (ONE_VALUE) {
        if (fragment.y <= 0.0) discard;
        fragment.x *= BLENDED_SIGN;
        fragment.a -= depth_before;
    }
#endif
}
