// Classifies the value that all sheets of a pixel were joined to.
#define VARYING
#define FLAT
#define ROWS 1
#define STRIDE 1.0
#include "footprint_eval.glsl"
vec2 first;
#include "sheet_composite.glsl"

uniform sampler2D joined_values;  // as sheet_close.frag writes them

uniform bool partial;             // of a part: what it joined is kept

out vec4 fragment;  // linear premultiplied; of a part as join_value and join_attenuated return it

void main() {
    vec4 light = texelFetch(joined_values, ivec2(gl_FragCoord.xy), 0);
    light.x *= BLENDED_SIGN;
    fragment = !partial ? shown(light) : light.y > 0.0 ? vec4(light.xy, 0.0, light.a) : vec4(0.0);
}
