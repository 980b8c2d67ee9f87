// Keeps the matter of one layer along each pixel's ray, which layers_over.comp composites with that of others.
// switch CARRIED 0  lists of pieces continue those of an earlier dispatch
#include "layer_pages.glsl"
#include "turns.glsl"
#define ROUNDING 5e-4  // of the length of a piece in a list, sheets

uniform uint layer;    // whose matter is kept
uniform uint band;     // pixels of a layer in the heads
uniform uint room;     // pages that there are; beyond them matter is lost
uniform float uneven;  // largest optical depth, or light, that joining matter moves along the ray
uint kept_tile, kept_lane;
// of a pixel's list the first and last page, and the number of pieces in pages
uvec3 kept[ROWS];
// a pixel's matter that is not kept yet, its ends, in sheets, and how much of it joining may have moved
vec4 waiting[ROWS];
vec2 waiting_ends[ROWS];
float moved[ROWS];

uint head_of_row(int row) {
    return head_of(layer, band, kept_pixel(kept_tile, uint(row), kept_lane));
}

// Sets the tile and the invocation of its group whose matter is kept.
void set_column(uint tile, uint lane) {
    kept_tile = tile;
    kept_lane = lane;
}

// continues: whether an earlier dispatch kept matter of the pixel.
void begin_matter(int row, bool continues) {
    waiting[row] = vec4(0.0);
    waiting_ends[row] = vec2(0.0);
    moved[row] = 0.0;
    kept[row] = uvec3(0u);
    if (CARRIED == 0 || !continues) return;
    uint head = head_of_row(row);
    uvec4 piece = last_piece(head);
    kept[row] = uvec3(kept_heads[head], kept_heads[head + 6u], kept_heads[head + 1u]);
    waiting[row] = matter_of_piece(piece, style.brightest);
    waiting_ends[row] = ends_of_piece(piece);
    moved[row] = uintBitsToFloat(kept_heads[head + 7u]);
}

void turn_matter() {
    TURN(uvec3, kept)
    TURN(vec4, waiting)
    TURN(vec2, waiting_ends)
    TURN(float, moved)
}

// Keeps the matter of a pixel that waits, and its list.
void end_matter(int row) {
    uint head = head_of_row(row);
    uvec4 piece = packed_piece(waiting_ends[row], waiting[row], style.brightest);
    kept_heads[head] = kept[row].x;
    kept_heads[head + 1u] = kept[row].z;
    kept_heads[head + 2u] = piece.x;
    kept_heads[head + 3u] = piece.y;
    kept_heads[head + 4u] = piece.z;
    kept_heads[head + 5u] = piece.w;
    if (CARRIED == 0) return;
    kept_heads[head + 6u] = kept[row].y;
    kept_heads[head + 7u] = floatBitsToUint(moved[row]);
}

// Adds matter between two places, in sheets from the first, to what waits, if that is about as dense, or both are thin.
// What is set under a condition takes longer: only what is stored is.
void add_matter(int row, vec2 ends, vec4 matter) {
    vec2 before = waiting_ends[row];
    vec4 before_matter = waiting[row], both = before_matter + matter;
    float length_ = ends.y - before.x;
    vec4 difference = abs(matter - both * ((ends.y - ends.x) / length_));
    float moves = moved[row] + max(max(difference.r, difference.g), max(difference.b, difference.a));
    bool holds = matter.a >= 1e-8, waits = before_matter.a > 0.0;
    bool joins = waits && ends.x <= before.y + ROUNDING && length_ < LONGEST_PIECE && moves < uneven;
    if (holds && waits && !joins) {
        kept[row] = keep_piece(kept[row], room, packed_piece(before, before_matter, style.brightest));
    }
    waiting[row] = holds ? (joins ? both : matter) : before_matter;
    waiting_ends[row] = holds ? vec2(joins ? before.x : ends.x, ends.y) : before;
    moved[row] = holds ? (joins ? moves : 0.0) : moved[row];
}
