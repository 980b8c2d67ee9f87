// Places splats in drawing order, one for each pixel of some textures: what vertices hand to their fragments.
// switch ORDERED 1
// switch CULLED 0
#define ATTRIBUTE
#define VARYING
#define FLAT
#include "placing.glsl"
#include "tiles.glsl"

// records of 9 words: see splatgl/splat/rows.py
uniform usampler2D records;   // words 0 to 3 and 4 to 7
uniform usampler2D rest;      // the last
#if ORDERED
uniform usampler2D order;     // indices of records
#endif
uniform uint first;           // of the drawing order, and the one that ends it
uniform uint end;
#if CULLED
#define BLOCK 256u
layout(std430, binding = 4) readonly buffer Blocks { uint blocks[]; };  // those of the drawing order that are shown
#endif

layout(location = 0) out uvec4 bounds;
layout(location = 1) out uvec4 head;
layout(location = 2) out uvec4 shape;
#if BENT
layout(location = 3) out uvec4 matter;
layout(location = 4) out uvec4 out_bend;
#if !CUBIC
layout(location = 5) out uvec4 out_cubic;
layout(location = 6) out uvec4 out_mixed;
#endif
#endif

void read_record(uint n) {
    ivec2 at = texel_of(n);
    uvec4 a = texelFetch(records, at * ivec2(2, 1), 0);
    uvec4 b = texelFetch(records, at * ivec2(2, 1) + ivec2(1, 0), 0);
    int xy = int(b.w), zr = int(texelFetch(rest, at, 0).r);
    in_position = uintBitsToFloat(a.xyz);
    in_optical_depth = uintBitsToFloat(a.w);
    in_color = uintBitsToFloat(b.xyz);
    // signed halves
    in_normal = ivec3((xy << 16) >> 16, xy >> 16, (zr << 16) >> 16);
    in_runs = zr >> 16;
}

void main() {
    ivec2 at = ivec2(gl_FragCoord.xy);
    uint n = uint(at.y) * ABREAST + uint(at.x);
#if CULLED
    n = blocks[n / BLOCK] * BLOCK + n % BLOCK;
    bool drawn = n >= first && n < end;
#else
    n += first;
    const bool drawn = true;
#endif
#if ORDERED
    n = texelFetch(order, texel_of(n), 0).r;
#endif
    read_record(n);
    vec3 v = eye_from_index() * (in_position - frame.base.xyz) - frame.eye_from_base.xyz;
    Sprite sprite;
    bool seen;
    PLANE quad = place_sprite(v, sprite, seen);
    give_matter(v, quad);
    // whether or not its block is left out, one too far beyond the edge is in no tile's list
    bool reaches = all(lessThanEqual(abs(pixel - frame.image_center), frame.reach));
    float half_side = seen && drawn && reaches ? 0.5 * sprite.size : UNSEEN;
    vec3 triangle = triangle_of(to_local);
    bounds = floatBitsToUint(vec4(pixel, half_side, circle_around(triangle, half_side)));
    head = floatBitsToUint(vec4(pixel, splat.a, half_side));
#if BENT
    shape = floatBitsToUint(to_local);
    matter = floatBitsToUint(vec4(splat.rgb, coverage));
    out_bend = floatBitsToUint(bend);
#if !CUBIC
    out_cubic = floatBitsToUint(cubic);
    out_mixed = floatBitsToUint(mixed);
#endif
#else
    vec3 color = splat.rgb / style.brightest;
    head.w = packUnorm2x16(color.rg);
    shape = uvec4(floatBitsToUint(triangle), packUnorm2x16(vec2(color.b, 0.0)));
#endif
}
