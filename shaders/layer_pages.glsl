// Stores the matter of layers along each pixel's ray: a list of pages, each of PAGE − 1 pieces and the number of the next
// page.
#constant COLUMNS
#constant TILE_ROWS
#constant PAGE
#define LONGEST_PIECE 16.0
layout(std430, binding = 7) buffer Pages { uvec4 kept_pages[]; };
// pages taken; then of each pixel of each layer a list: its first page, the number of pieces in pages, its last piece,
// which is in none, and, where other dispatches continue it, its last page and what joining has moved
#define HEAD 8u  // words of a list
layout(std430, binding = 1) buffer Heads { uint kept_heads[]; };

uint head_of(uint layer, uint band, uint pixel) {
    return 1u + HEAD * (layer * band + pixel);
}

// lane: of the invocation whose first pixel is `row` pixels above.
uint kept_pixel(uint tile, uint row, uint lane) {
    return (tile * uint(TILE_ROWS) + row) * uint(COLUMNS) + lane;
}

// A list's last piece; of an empty list 0.
uvec4 last_piece(uint head) {
    return uvec4(kept_heads[head + 2u], kept_heads[head + 3u], kept_heads[head + 4u], kept_heads[head + 5u]);
}

// Adds a piece to the pages of a list, which it returns; pieces beyond the room of so many pages are lost.
uvec3 keep_piece(uvec3 list, uint room, uvec4 piece) {
    uint at = list.z % uint(PAGE - 1);
    if (at == 0u) {
        uint page = atomicAdd(kept_heads[0], 1u);
        if (list.z == 0u) list.x = page;
        else if (page < room) kept_pages[(list.y + 1u) * uint(PAGE) - 1u].x = page;
        list.y = page;
    }
    if (list.y < room) kept_pages[list.y * uint(PAGE) + at] = piece;
    return list + uvec3(0u, 0u, 1u);
}

uint packed_pair(vec2 pair) {
    return packUnorm2x16(pair);
}

vec2 unpacked_pair(uint word) {
    return unpackUnorm2x16(word);
}

#include "layer_piece.glsl"
