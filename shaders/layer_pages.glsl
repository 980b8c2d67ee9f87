// Stores the matter of layers along each pixel's ray: a list of pages, each of PAGE − 1 pieces and the number of the next
// page.
#constant COLUMNS
#constant TILE_ROWS
#constant PAGE
#define LONGEST_PIECE 16.0
layout(std430, binding = 7) buffer Pages { uvec4 kept_pages[]; };
// pages taken; then for each pixel of each layer its first and last page, and how many pieces it has
layout(std430, binding = 1) buffer Heads { uint kept_heads[]; };

uint head_of(uint layer, uint band, uint pixel) {
    return 4u * (1u + layer * band + pixel);
}

// lane: of the invocation whose first pixel is `row` pixels above.
uint kept_pixel(uint tile, uint row, uint lane) {
    return (tile * uint(TILE_ROWS) + row) * uint(COLUMNS) + lane;
}

// Adds a piece to a pixel's list; false, and only counted, beyond the room of so many pages.
bool keep_piece(uint head, uint room, uvec4 piece) {
    uint count = kept_heads[head + 2u], at = count % uint(PAGE - 1);
    if (at == 0u) {
        uint page = atomicAdd(kept_heads[0], 1u);
        if (page >= room) return false;
        if (count == 0u) kept_heads[head] = page;
        else kept_pages[(kept_heads[head + 1u] + 1u) * uint(PAGE) - 1u].x = page;
        kept_heads[head + 1u] = page;
    }
    kept_pages[kept_heads[head + 1u] * uint(PAGE) + at] = piece;
    kept_heads[head + 2u] = count + 1u;
    return true;
}

uint packed_pair(vec2 pair) {
    return packUnorm2x16(pair);
}

vec2 unpacked_pair(uint word) {
    return unpackUnorm2x16(word);
}

#include "layer_piece.glsl"
