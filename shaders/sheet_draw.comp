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

#include "open_sheets.glsl" if CARRIED else "open_sheets_off.glsl"

// Composites a tile's list. mine: its element of lists; lane: the invocation.
void composite_tile(uvec4 mine, uint lane);

// A splat's share of a pixel, and what it adds to sheets times their weights.
float valued(Joined it, Ray ray, int row) {
    choose(it);
    return share_at(it, ray, float(row) * STRIDE) * (STEPS == 0 ? it.splat.a : 1.0);
}

vec4 term_of(int row, Joined it) {
    return STEPS == 0 ? vec4(it.splat.rgb, 1.0) : held_sums(row, it.splat);
}

// Adds four splats at once: sums are stored under a mask, which takes longer than to add them up.
void add_four(int row, Joined four[4], Ray ray, vec4 weights[4]) {
    vec4 v = vec4(valued(four[0], ray, row), valued(four[1], ray, row), valued(four[2], ray, row),
                  valued(four[3], ray, row));
    mat4 shares = mat4(weights[0] * v.x, weights[1] * v.y, weights[2] * v.z, weights[3] * v.w);
    mat4 terms = mat4(term_of(row, four[0]), term_of(row, four[1]), term_of(row, four[2]), term_of(row, four[3]));
    mat4 by_sheet = transpose(shares);
    sum0[row] += terms * by_sheet[0];
    sum1[row] += terms * by_sheet[1];
    if (SHEETS > 2) sum2[row] += terms * by_sheet[2];
    if (SHEETS > 3) sum3[row] += terms * by_sheet[3];
    if (STEPS > 0) masses[row] += shares * vec4(1.0);
}

// Adds a splat to a pixel's open sheets, by a weight in each.
void add_splat(int row, Joined it, Ray ray, vec4 weights) {
    vec4 shares = weights * valued(it, ray, row), term = term_of(row, it);
    sum0[row] += term * shares.x;
    sum1[row] += term * shares.y;
    if (SHEETS > 2) sum2[row] += term * shares.z;
    if (SHEETS > 3) sum3[row] += term * shares.w;
    if (STEPS > 0) masses[row] += shares;
}

void open_pixel(int row) {
    sum0[row] = sum1[row] = sum2[row] = sum3[row] = masses[row] = vec4(0.0);
    middle[row] = before[row] = vec4(0.0);
    held[row] = spread[row] = vec3(0.0);
    light[row] = vec4(0.0);
    if (STEPS > 0 || LIMITED == 1) set_ray(row);
}

void main() {
    uint n = gl_WorkGroupID.x + (CARD == 1 ? first_tile : 0u);
    uvec4 mine = lists[n];
    if (CARD == 1) mine = uvec4(n, mine.yz, uint(complete));
    composite_tile(mine, gl_LocalInvocationID.x);
}

#include "sheet_pixels.glsl" if CARD else "sheet_columns.glsl"
