// Pairs each splat with its first sheet, on a card. Splats beyond the picture's edges get a sheet after all others.
// version 430
#constant SORT_LANES
layout(local_size_x = SORT_LANES) in;
#define VARYING
#define FLAT
#include "projection.glsl"
#include "sheets.glsl"
#include "tiles.glsl"
#include "records.glsl"
#include "first_sheet.glsl"
#include "card_work.glsl"

layout(std430, binding = 1) writeonly buffer Pairs { uvec2 pairs[]; };
uniform usampler2D records;
uniform uint count;
uniform uint number;  // of sheets

void main() {
    // a dispatch has no more groups than every OpenGL allows
    for (uint n = gl_GlobalInvocationID.x; n < count; n += gl_NumWorkGroups.x * SORT_LANES) {
        vec3 position = record_position(texelFetch(records, texel_of(n) * ivec2(1 + POINTS, 1), 0));
        uint sheet = first_sheet_of(position, number);
        pairs[n] = uvec2(sheet, n);
        if (sheet < number) atomicAdd(drawn, 1u);
    }
}
