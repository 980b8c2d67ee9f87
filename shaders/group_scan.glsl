// Sums within a work group of SORT_LANES lanes.
#include "wait_for_all.glsl"
#constant SORT_LANES
shared uvec4 scanned[SORT_LANES];

// Leaves in `scanned` the sums of the lanes' values up to each lane, inclusive.
void scan_group(uvec4 value) {
    uint lane = gl_LocalInvocationID.x;
    scanned[lane] = value;
    wait_for_all();
    for (uint step_ = 1u; step_ < SORT_LANES; step_ *= 2u) {
        uvec4 earlier = lane >= step_ ? scanned[lane - step_] : uvec4(0u);
        wait_for_all();
        scanned[lane] += earlier;
        wait_for_all();
    }
}

// The sum of the lanes before this one, after scan_group.
uvec4 scanned_before() {
    return gl_LocalInvocationID.x > 0u ? scanned[gl_LocalInvocationID.x - 1u] : uvec4(0u);
}
