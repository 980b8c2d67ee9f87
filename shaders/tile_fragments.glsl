// The fragments of tiles that sheet_draw.frag draws: of a tile 4 × 2, which a processor draws at a time, each a column of
// pixels; or as many as pixels.
const ivec2 SIDES = ROWS == 1 ? ivec2(COLUMNS, TILE_ROWS) : ivec2(COLUMNS / 2, 2);

ivec2 tile_of(ivec2 fragment) {
    return fragment / SIDES;
}

// The number of a fragment within its tile, see first_pixel.
uint lane_of(ivec2 fragment) {
    ivec2 part = fragment - tile_of(fragment) * SIDES;
    return uint(part.y * SIDES.x + part.x);
}

// The fragment that draws a pixel of the tiles.
ivec2 fragment_of(ivec2 pixel) {
    ivec2 tile = pixel / ivec2(COLUMNS, TILE_ROWS), part = pixel - tile * ivec2(COLUMNS, TILE_ROWS);
    return tile * SIDES + (ROWS == 1 ? part : ivec2(part.x % SIDES.x, part.x / SIDES.x));
}
