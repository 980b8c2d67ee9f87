// Composites tiles of boxes of voxels: each invocation blends its tile's list into one pixel, front to back.
// version 430
// switch CARRIED 0  tiles continue what an earlier dispatch drew
// switch LAYERED 0  the matter is kept for layers_over.comp
// switch CARD 0     lists are read from a buffer
#constant COLUMNS    // invocations of a group, along x,
#constant TILE_ROWS  // and along y
layout(local_size_x = COLUMNS, local_size_y = TILE_ROWS) in;
#define ROWS 1       // pixels of an invocation
#define VARYING
#define FLAT
#include "boxes.glsl"
#include "optics.glsl"
#include "tiles.glsl"
#include "layer_matter.glsl" if LAYERED else "layer_matter_off.glsl"

layout(std430, binding = 2) readonly buffer Lists { uvec4 lists[]; };  // tile, begin, end
layout(std430, binding = 3) buffer Open { uint open[]; };              // tiles that have not terminated; states on a card
#include "tile_states.glsl" if CARD else "tile_states_off.glsl"
layout(std430, binding = 6) readonly buffer Listed { uint listed[]; };
layout(rgba32f, binding = 0) uniform image2D target;
uniform usampler2D list;
uniform usampler2D heads;   // of a splat: its place from frame.base; its optical depth, or opacity
uniform usampler2D shapes;  // its colour
uniform float opaque;       // opacity at which a pixel terminates

// Entry `at` of the lists.
uint entry(uint at) {
    return CARD == 1 ? listed[at] : texelFetch(list, listed_at(at), 0)[at & 3u];
}

void main() {
    uvec4 mine = lists[gl_WorkGroupID.x];
    uint tile = CARD == 1 ? gl_WorkGroupID.x : mine.x, at = mine.y, end = mine.z;
    if (CARD == 1 && (open[tile] == CLOSED || at == end)) return;
    begin_state();
    ivec2 pixel = first_pixel(tile, gl_LocalInvocationIndex);
    BoxRay ray = box_ray(vec2(pixel) + 0.5);
    vec4 light = CARRIED == 1 ? imageLoad(target, pixel) : vec4(0.0);
    set_column(tile, gl_LocalInvocationIndex);
    begin_matter(0, true);
    float speed = length(ray.direction);
    float offset = PERSPECTIVE == 1 ? 0.0 : dot(ray.start - box_eye, ray.direction) / speed;
    // one loop, with its light: llvmpipe loses lanes of one within it that goes on to the next box that a ray meets
    for (; at < end && (!IN_ORDER || light.a <= opaque); at++) {
        ivec2 texel = texel_of(entry(at));
        vec4 it = uintBitsToFloat(texelFetch(heads, texel, 0));
        vec2 ends = box_ends(ray, it.xyz);
        if (ends.y <= ends.x) continue;
        vec4 matter = vec4(uintBitsToFloat(texelFetch(shapes, texel, 0).rgb), 1.0);
        if (IN_ORDER) {
            vec2 shone = box_light(ray, ends);
            matter.rgb = matter.rgb * shone.x + shone.y;
        }
        matter *= it.w * joined_length((ends.y - ends.x) * ray.stretch);
        add_matter(0, ends * speed + offset, matter);
        light = join_matter(light, matter);
    }
    end_matter(0);
    imageStore(target, pixel, light);
    set_state(tile, !IN_ORDER || light.a <= opaque);
}
