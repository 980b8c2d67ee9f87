// Composites a complete sheet behind the light of nearer sheets, or joins its values to theirs.
#define VARYING
#define FLAT
#define ROWS 1
#include "footprint_eval.glsl"
vec2 first;  // the pixel's centre in its band
#include "sheet_composite.glsl"

uniform sampler2D sheet_sums;    // of the sheet
uniform sampler2D sheet_masses;
uniform sampler2D sums_before;   // of the sheet before
uniform sampler2D masses_before;
uniform sampler2D sums_earlier;  // of the one before that
uniform sampler2D masses_earlier;
uniform int sheet;               // its number
uniform int top;                 // the picture's row at which the band begins whose sheets these are

// linear premultiplied, for 'over' from the front to the back; of one value: it, or for a mean the sum by length, and
// the length; for a minimum −value, as blending takes the maximum of both
out vec4 fragment;

void main() {
    first = gl_FragCoord.xy - vec2(0.0, float(top));
    ivec2 pixel = ivec2(first);
    sum0[0] = texelFetch(sheet_sums, pixel, 0);
    light[0] = vec4(0.0);
    if (STEPS == 0) {
        if (sum0[0].a <= 0.0) discard;
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
    close_sheet(0, sheet);
    fragment = light[0];
    if (ONE_VALUE) {
        if (fragment.y <= 0.0) discard;
        fragment.x *= BLENDED_SIGN;
    }
}
