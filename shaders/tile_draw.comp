// Composites tiles: each invocation blends its tile's list into its pixels, front to back.
// switch CARRIED 0  tiles continue what an earlier dispatch drew
// switch CARD 0     a graphics card's shape: one pixel an invocation, splats in shared memory
// switch LANES 8    invocations of a group
// switch ROWS 8     pixels of an invocation, in a column
// version 430
layout(local_size_x = LANES) in;
#include "tile_splat.glsl"

layout(std430, binding = 2) readonly buffer Lists { uvec4 lists[]; };      // tile, begin, end
layout(std430, binding = 3) buffer Open { uint open[]; };                  // tiles that have not terminated; states on a card
layout(rgba32f, binding = 0) uniform image2D target;
uniform float opaque;    // opacity at which a tile terminates

// Composites a tile's list. mine: its element of lists; lane: the invocation.
void composite_tile(uvec4 mine, uint lane);

// With the depth scaled for quick_one_minus_exp.
Joined scaled(Joined it) {
    if (IN_ORDER) it.splat.a *= QUICK_SCALE;
    return it;
}

void main() {
    uvec4 mine = lists[gl_WorkGroupID.x];
    if (CARD == 1) mine.x = gl_WorkGroupID.x;
    composite_tile(mine, gl_LocalInvocationID.x);
}

#include "splat_pixels.glsl" if CARD else "splat_columns.glsl"
