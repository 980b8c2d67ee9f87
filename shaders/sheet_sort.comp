// Sorts splats by their first sheet: counts those of each run by sheet, or writes their numbers in order. Splats beyond
// the picture's edges come last. Each invocation processes one run of splats.
// switch COUNTING 0  only counts
// switch LANES 8     invocations of a group
// version 430
layout(local_size_x = LANES) in;
#define VARYING
#define FLAT
#include "projection.glsl"
#include "sheets.glsl"
#include "tiles.glsl"
#include "records.glsl"
#include "first_sheet.glsl"

layout(std430, binding = 0) buffer Cursors { uint cursors[]; };  // per run and sheet: the count, or the next position
layout(r32ui, binding = 0) writeonly uniform uimage2D order;
uniform usampler2D records;

uniform uint count;
uniform uint length_;  // of a run
uniform uint number;   // of sheets; the next slot is of splats beyond the edges

void main() {
    uint run = gl_GlobalInvocationID.x;
    uint column = run * (number + 1u);
    uint n = run * length_;
    uint end = min(n + length_, count);
    for (; n < end; n++) {
        vec3 position = record_position(texelFetch(records, texel_of(n) * ivec2(1 + POINTS, 1), 0));
        uint slot = column + first_sheet_of(position, number);
        uint place = cursors[slot];
        if (COUNTING == 0) imageStore(order, texel_of(place), uvec4(n));
        cursors[slot] = place + 1u;
    }
}
