// Sorts splats by their first sheet: counts those of each run by sheet, or writes their numbers in order. Splats beyond
// the picture's edges, or the sheets of a round, are left out. Each invocation processes one run of splats.
// switch COUNTING 0   only counts
// switch CLUSTERED 0  a run has parts of the order of clusters
// switch LANES 8      invocations of a group
// version 430
layout(local_size_x = LANES) in;
#define VARYING
#define FLAT
#include "projection.glsl"
#include "sheets.glsl"
#include "tiles.glsl"
#include "records.glsl"
#include "first_sheet.glsl"
#constant SIDE_BITS  // of a cell within a cluster, along an axis
#constant NAME_BITS  // of a record's number

layout(std430, binding = 0) buffer Cursors { uint cursors[]; };  // per run and sheet: the count, or the next position
// parts: begin, end, and the first cell of a cluster, x and y in one word; and for each run its first part, then the end
layout(std430, binding = 2) readonly buffer Parts { uvec4 parts[]; };
layout(std430, binding = 3) readonly buffer Runs { uint runs[]; };
layout(r32ui, binding = 0) writeonly uniform uimage2D order;
uniform usampler2D records;
uniform usampler2D clustered;  // numbers of records by cluster, with their cells within it

uniform uint first_run;  // of the dispatch
uniform uint count;
uniform uint length_;  // of a run
uniform uint sheets;   // of all splats
uniform uint begin;    // first sheet of the round
uniform uint number;   // of its sheets; the next slot is of splats that are left out

void main() {
    uint run = first_run + gl_GlobalInvocationID.x;
    uint column = run * (number + 1u);
    uint n = run * length_, end = min(n + length_, count), at = 0u, last = 0u;
    uvec4 part = uvec4(0u);
    if (CLUSTERED == 1) {
        at = runs[run];
        last = runs[run + 1u];
        if (at < last) part = parts[at];
        n = part.x;
        end = part.y;
    }
    while (n < end) {
        uint word = CLUSTERED == 1 ? texelFetch(clustered, texel_of(n), 0).r : n;
        uint name = CLUSTERED == 1 ? word & ((1u << NAME_BITS) - 1u) : n;
        vec3 position;
        if (CLUSTERED == 1 && POINTS == 0) {
            // the cell from the cluster's first, without the record
            uvec3 cell = (uvec3(word) >> (uvec3(0u, 1u, 2u) * SIDE_BITS + NAME_BITS)) & ((1u << SIDE_BITS) - 1u);
            position = vec3(uvec3(part.z & 0xffffu, part.z >> 16, part.w) + cell);
        } else position = record_position(texelFetch(records, texel_of(name) * ivec2(1 + POINTS, 1), 0));
        uint sheet = first_sheet_of(position, sheets) - begin;
        uint slot = column + min(sheet, number);
        uint place = cursors[slot];
        if (COUNTING == 0 && sheet < number) imageStore(order, texel_of(place), uvec4(name));
        cursors[slot] = place + 1u;
        n++;
        if (CLUSTERED == 1 && n == end && ++at < last) {
            part = parts[at];
            n = part.x;
            end = part.y;
        }
    }
}
