// Sums numbers up to each, exclusive, in one group, on a card: of the digits of a sort's blocks, or of the pairs of groups
// of splats, which then become the entries of the next sort.
// switch PAIRS 0  sums pairs
// version 430
#constant SORT_LANES
layout(local_size_x = SORT_LANES) in;
#include "group_scan.glsl"
#include "card_work.glsl"
#define DIGITS 16u
#define EACH 16u  // numbers that a lane adds up at a time

layout(std430, binding = 1) buffer Counts { uint counts[]; };
uniform uint number;   // of groups of splats; 0: their sums are there already
uniform uint skipped;  // pairs that earlier sorts of these splats took
uniform uint room;     // pairs of a sort

void main() {
    uint lane = gl_LocalInvocationID.x, sum = 0u;
    uint end = PAIRS == 1 ? number : DIGITS * blocks_of(entries);
    for (uint start = 0u; start < end; start += EACH * SORT_LANES) {
        uint values[EACH], own = 0u, n = start + EACH * lane;
        for (uint i = 0u; i < EACH; i++) {
            values[i] = n + i < end ? counts[n + i] : 0u;
            own += values[i];
        }
        scan_group(uvec4(own, 0u, 0u, 0u));
        uint before = sum + scanned_before().x;
        sum += scanned[SORT_LANES - 1u].x;
        for (uint i = 0u; i < EACH; i++) {
            if (n + i < end) counts[n + i] = before;
            before += values[i];
        }
        wait_for_all();
    }
    if (PAIRS == 1 && lane == 0u) {
        if (number > 0u) total = sum;
        most = max(most, total);
        set_entries(min(total - min(skipped, total), room));
    }
}
