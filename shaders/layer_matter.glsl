// Keeps the matter of one layer along each pixel's ray, which layers_over.comp composites with that of others.
#include "layer_pages.glsl"

uniform uint layer;  // whose matter is kept
uniform uint band;   // pixels of a layer in the heads
uniform uint room;   // pages that there are; beyond them matter is only counted
uniform float thin;  // largest optical depth of a piece that is joined from several
uint kept_tile, kept_lane;
// a pixel's matter that is not kept yet, and its ends, in sheets
vec4 waiting[ROWS];
vec2 waiting_ends[ROWS];

// Sets the tile and the invocation of its group whose matter is kept.
void set_column(uint tile, uint lane) {
    kept_tile = tile;
    kept_lane = lane;
}

void begin_matter(int row) {
    waiting[row] = vec4(0.0);
}

// Keeps a piece of a pixel's matter. ends: in sheets from the first. Returns false beyond the room.
bool keep_matter(int row, vec2 ends, vec4 matter) {
    uint head = head_of(layer, band, kept_pixel(kept_tile, uint(row), kept_lane));
    return keep_piece(head, room, packed_piece(ends, matter, style.brightest));
}

// Keeps the matter of a pixel that waits.
void end_matter(int row) {
    if (waiting[row].a < 1e-30) return;
    if (keep_matter(row, waiting_ends[row], waiting[row])) waiting[row] = vec4(0.0);
}

// Adds matter between two places, in sheets from the first, to what waits if both are thin.
void add_matter(int row, vec2 ends, vec4 matter) {
    if (matter.a < 1e-8) return;
    bool joins = ends.x <= waiting_ends[row].y && ends.y < waiting_ends[row].x + LONGEST_PIECE;
    if (waiting[row].a > 0.0 && !(joins && waiting[row].a + matter.a < thin)) end_matter(row);
    if (waiting[row].a == 0.0) waiting_ends[row].x = ends.x;
    waiting_ends[row].y = ends.y;
    waiting[row] += matter;
}
