// Pairs splats with the tiles they touch, on a card: counts the tiles of each splat, or writes one pair a lane, in the
// order of splats. Of splats that touch few tiles, those that have terminated are left out.
// switch COUNTING 0  only counts
// version 430
#constant SORT_LANES
layout(local_size_x = SORT_LANES) in;
#define VARYING
#define FLAT
#include "tiles.glsl"
#include "group_scan.glsl"
#include "card_work.glsl"
#constant CLOSED  // state of a terminated tile
#define FEW 32

// of each group of splats: its pairs; then those of all groups before
layout(std430, binding = 1) buffer Counts { uint counts[]; };
// of each splat: the pairs of those before it in its group
layout(std430, binding = 2) buffer Offsets { uint offsets[]; };
layout(std430, binding = 3) readonly buffer Open { uint open[]; };
layout(std430, binding = 4) writeonly buffer Pairs { uvec2 pairs[]; };
uniform usampler2D bounds;
uniform uint first;    // of the splats, in the order of all
uniform uint count;    // of splats
uniform uint skipped;  // pairs that earlier sorts of these splats took

struct Touched {
    vec2 center;
    Extent extent;
    ivec2 rows;
    int area;  // tiles, terminated ones included
};

Touched tiles_of(uint n) {
    vec4 it = uintBitsToFloat(texelFetch(bounds, texel_of(n), 0));
    Extent extent = unpacked_extent(it.zw);
    ivec2 rows = first + n < drawn ? rows_of(it.y, extent.height) : ivec2(1, 0);
    int area = 0;
    for (int row = rows.x; row <= rows.y; row++) {
        ivec2 span = span_of(it.xy, extent, row);
        area += max(span.y - span.x + 1, 0);
    }
    return Touched(it.xy, extent, rows, area);
}

// The tile with so many of a splat's tiles before it; and, for more than there are, in `left` how many more.
uint tile_number(Touched it, inout int left) {
    for (int row = it.rows.x; row <= it.rows.y; row++) {
        ivec2 span = span_of(it.center, it.extent, row);
        uint begin = uint(row * tiles.x + span.x);
        int length_ = max(span.y - span.x + 1, 0);
        if (it.area > FEW) {
            if (left < length_) return begin + uint(left);
            left -= length_;
        } else {
            for (uint tile = begin; tile < begin + uint(length_); tile++) {
                if (open[tile] == CLOSED) continue;
                if (left == 0) return tile;
                left--;
            }
        }
    }
    return 0u;
}

void count_pairs(uint n) {
    uint number = 0u;
    if (n < count) {
        Touched it = tiles_of(n);
        int left = it.area;
        tile_number(it, left);
        number = uint(it.area > FEW ? it.area : it.area - left);
    }
    scan_group(uvec4(number, 0u, 0u, 0u));
    offsets[n] = scanned_before().x;
    if (gl_LocalInvocationID.x == SORT_LANES - 1u) counts[gl_WorkGroupID.x] = scanned[SORT_LANES - 1u].x;
}

// The last group of splats with at most so many pairs before it, then the last splat of it.
uint splat_of(uint at) {
    uint low = 0u, high = (count + SORT_LANES - 1u) / SORT_LANES;
    while (high - low > 1u) {
        uint middle = (low + high) / 2u;
        if (counts[middle] <= at) low = middle;
        else high = middle;
    }
    uint within = at - counts[low];
    low *= SORT_LANES;
    high = low + SORT_LANES;
    while (high - low > 1u) {
        uint middle = (low + high) / 2u;
        if (offsets[middle] <= within) low = middle;
        else high = middle;
    }
    return low;
}

void main() {
    uint n = gl_GlobalInvocationID.x;
    if (COUNTING == 1) count_pairs(n);
    else if (n < entries) {
        uint at = n + skipped, splat = splat_of(at);
        int left = int(at - counts[splat / SORT_LANES] - offsets[splat]);
        pairs[n] = uvec2(tile_number(tiles_of(splat), left), splat);
    }
}
