// Finds where the list of each tile begins and ends among pairs that are sorted by tile, on a card.
// version 430
#constant SORT_LANES
layout(local_size_x = SORT_LANES) in;
#include "card_work.glsl"

layout(std430, binding = 1) readonly buffer Pairs { uvec2 pairs[]; };
layout(std430, binding = 2) writeonly buffer Lists { uvec4 lists[]; };  // tile, begin, end, whether it is complete then
layout(std430, binding = 6) writeonly buffer Listed { uint listed[]; };

void main() {
    uint n = gl_GlobalInvocationID.x;
    if (n >= entries) return;
    uvec2 pair = pairs[n];
    listed[n] = pair.y;
    if (n == 0u || pairs[n - 1u].x != pair.x) lists[pair.x].y = n;
    if (n + 1u == entries || pairs[n + 1u].x != pair.x) lists[pair.x].z = n + 1u;
}
