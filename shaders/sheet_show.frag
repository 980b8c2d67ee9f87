// Classifies the value that all sheets of a pixel were joined to.
#define VARYING
#define FLAT
#define ROWS 1
#include "footprint_eval.glsl"
vec2 first;
#include "sheet_composite.glsl"

uniform sampler2D joined_values;  // as sheet_close.frag writes them

out vec4 fragment;  // linear premultiplied

void main() {
    vec4 light = texelFetch(joined_values, ivec2(gl_FragCoord.xy), 0);
    light.x *= BLENDED_SIGN;
    fragment = shown(light);
}
