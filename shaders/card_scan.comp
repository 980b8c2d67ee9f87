// Sums numbers up to each, exclusive, in one group, on a card: of the digits of a sort's blocks, or of the pairs of groups
// of splats, which then become the entries of the next sort.
// switch PAIRS 0  sums pairs
// version 430
#constant SORT_LANES
layout(local_size_x = SORT_LANES) in;
#include "group_scan.glsl"
#include "card_work.glsl"
#define DIGITS 16u

layout(std430, binding = 1) buffer Counts { uint counts[]; };
uniform uint number;   // of groups of splats; 0: their sums are there already
uniform uint skipped;  // pairs that earlier sorts of these splats took
uniform uint room;     // pairs of a sort

void main() {
    uint lane = gl_LocalInvocationID.x, sum = 0u;
    uint end = PAIRS == 1 ? number : DIGITS * blocks_of(entries);
    for (uint start = 0u; start < end; start += 4u * SORT_LANES) {
        uvec4 four = uvec4(0u);
        uint n = start + 4u * lane;
        for (uint i = 0u; i < 4u; i++) if (n + i < end) four[i] = counts[n + i];
        uvec4 upto = uvec4(four.x, four.x + four.y, four.x + four.y + four.z, four.x + four.y + four.z + four.w);
        scan_group(uvec4(upto.w, 0u, 0u, 0u));
        uint before = sum + scanned_before().x;
        sum += scanned[SORT_LANES - 1u].x;
        for (uint i = 0u; i < 4u; i++) if (n + i < end) counts[n + i] = before + upto[i] - four[i];
        wait_for_all();
    }
    if (PAIRS == 1 && lane == 0u) {
        if (number > 0u) total = sum;
        most = max(most, total);
        set_entries(min(total - min(skipped, total), room));
    }
}
