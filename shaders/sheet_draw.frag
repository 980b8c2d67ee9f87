// Composites sheets tile by tile without compute shaders: each fragment draws a column of a tile's pixels, one in each
// output; the fragments of a tile are next to each other. Twin of sheet_draw.comp.
// switch ROWS 8       pixels of a fragment, in a column
// switch CARRIED 0    see sheet_draw.comp
// extension GL_ARB_shader_group_vote
#define VARYING
#include "tile_splat.glsl"
uniform float stride;           // pixels of the view from one sample to the next
#define STRIDE stride
#define LIST_TEXEL(at) texelFetch(list, at, 0)
#include "sheet_composite.glsl"

uniform usampler2D ranges;      // of each tile, the range of its list
uniform float opaque;           // opacity at which a tile terminates
const bool partial = false;
out vec4 pixels[ROWS];

#define LIGHT_AT(at) vec4(0.0)
#define SET_LIGHT(at, value) TURN(vec4, pixels) pixels[0] = value
#define STAY_OPEN(tile)
#include "open_sheets_off.glsl"
#include "sheet_sums.glsl"
#include "sheet_columns.glsl"
#include "tile_fragments.glsl"

void main() {
    for (int row = 0; row < ROWS; row++) pixels[row] = vec4(0.0);
    ivec2 tile = tile_of(ivec2(gl_FragCoord.xy));
    uvec2 range = texelFetch(ranges, tile, 0).rg;
    if (range.x < range.y || (NEAR == 1 && range.x == range.y))
        composite_tile(uvec4(tile.y * tiles.x + tile.x, range, 1u), lane_of(ivec2(gl_FragCoord.xy)));
}
