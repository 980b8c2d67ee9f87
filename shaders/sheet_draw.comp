// Composites sheets tile by tile: each invocation adds its tile's list, which is in the order of first sheets, to the
// open sheets of its pixels, and composites each sheet once the list has passed it.
// Twin of splatgl/reference/sheets.py.
// switch CARRIED 0    lists continue in other dispatches
// switch CARD 0       a graphics card's shape: one pixel an invocation, splats in shared memory
// switch LANES 8      invocations of a group
// switch ROWS 8       pixels of an invocation, in a column
// version 430
// extension GL_ARB_shader_group_vote
layout(local_size_x = LANES) in;
#include "tile_splat.glsl"
// pixels of the view from one sample to the next; a processor may first draw every other
uniform float stride;
#define STRIDE (CARD == 1 ? 1.0 : stride)
// unless it stores pieces in as many buffers as OpenGL allows beside images
#if CARD == 0 && LAYERED == 0
#define CLASS_TEXEL(at) imageLoad(class_table, at)
layout(rgba32ui, binding = 3) readonly uniform uimage2D class_table;
#define LIST_TEXEL(at) imageLoad(fours, at)
layout(rgba32ui, binding = 4) readonly uniform uimage2D fours;
#else
#define LIST_TEXEL(at) texelFetch(list, at, 0)
#endif
#include "sheet_composite.glsl"

layout(std430, binding = 2) readonly buffer Lists { uvec4 lists[]; };  // tile, begin, end; 1: complete then, 2: continued
layout(std430, binding = 3) buffer Open { uint open[]; };              // tiles that have not terminated; states on a card
layout(rgba32f, binding = 0) uniform image2D target;
uniform float opaque;           // opacity at which a tile terminates
// on a card, where each tile has a list: whether all lists are complete; the first tile whose open sheets are bound
uniform bool complete;
uniform uint first_tile;
uniform bool partial;           // what is drawn is a part, which shows no value yet

#define LIGHT_AT(at) imageLoad(target, at)
#define SET_LIGHT(at, value) imageStore(target, at, value)
#define STAY_OPEN(tile) open[tile] = 1u

#include "open_sheets.glsl" if CARRIED else "open_sheets_off.glsl"

#include "sheet_sums.glsl"

void main() {
    uint n = gl_WorkGroupID.x + (CARD == 1 ? first_tile : 0u);
    uvec4 mine = lists[n];
    if (CARD == 1) mine = uvec4(n, mine.yz, uint(complete));
    composite_tile(mine, gl_LocalInvocationID.x);
}

#include "sheet_pixels.glsl" if CARD else "sheet_columns.glsl"
