// Draws tiles: an invocation adds up all splats of its tile's list for one column of pixels, nearest first.
// switch CARRIED 0
layout(local_size_x = 8) in;
#define VARYING
#define FLAT
#include "value.glsl"
#include "tiles.glsl"

layout(std430, binding = 0) readonly buffer Cursors { uint cursors[]; };  // those of the last run: where lists end
layout(rgba32f, binding = 0) uniform image2D target;
uniform usampler2D list;
layout(std430, binding = 2) readonly buffer Filled { uint filled[]; };    // the tiles that have any
uniform usampler2D heads;
uniform usampler2D shapes;
#if BENT
uniform usampler2D matters;
uniform usampler2D bends;
#if !CUBIC
uniform usampler2D cubics;
uniform usampler2D mixeds;
#endif
#endif
uniform uint last;       // where the last run begins
uniform float opaque;    // a tile of pixels that hide more gets no more
uniform uint skipped;    // of each list, and how many to draw at most
uniform uint most;

// A splat that is joined to the pixels.
struct Joined {
    vec2 offset;         // of the column's first pixel
    float half_side;
    vec4 shape;
};

void join(inout vec4 light, Ray ray, Joined it, float row) {
    vec2 offset = it.offset + vec2(0.0, row);
#if BENT
    float value = splat.a * exact_share(local_place(offset), ray);
    // far beyond its rim a stretched footprint has no meaning
    if (max(abs(offset.x), abs(offset.y)) > it.half_side) value = 0.0;
#else
    // f.x x² and f.y x are the column's
    float r2 = it.shape.x + offset.y * (it.shape.y + offset.y * it.shape.z);
    float value = splat.a * radial(r2 * ray.shrink);
#if ALIGN == ALIGN_EXACT && !CUBIC && BLEND != BLEND_MIP
    value *= ray.length_ * sqrt(ray.shrink);
#endif
#endif
    value = blended(value);
#if BLEND == BLEND_MIP
    light = max(light, vec4(splat.rgb, 1.0) * value);
#else
#if BLEND == BLEND_COMPOSITE
    value *= 1.0 - light.a;
#endif
    light += vec4(splat.rgb, 1.0) * value;
#endif
}

Joined read_splat(uint place, vec2 first) {
    ivec2 texel = texel_of(texelFetch(list, listed_at(place), 0).r);
    uvec4 head = texelFetch(heads, texel, 0);
    uvec4 shape = texelFetch(shapes, texel, 0);
    Joined it = Joined(first - uintBitsToFloat(head.xy), uintBitsToFloat(head.w), uintBitsToFloat(shape));
#if BENT
    splat = uintBitsToFloat(texelFetch(matters, texel, 0));
#else
    splat = vec4(unpackUnorm2x16(head.w), unpackUnorm2x16(shape.w));
    splat.rgb *= style.brightest;
#endif
#if ATTENUATION == ATTENUATION_OPACITY
    coverage = splat.a;
#endif
    splat.a = uintBitsToFloat(head.z);
#if BENT
    to_local = it.shape;
    bend = uintBitsToFloat(texelFetch(bends, texel, 0));
#if !CUBIC
    cubic = uintBitsToFloat(texelFetch(cubics, texel, 0));
    mixed = uintBitsToFloat(texelFetch(mixeds, texel, 0));
#endif
#else
    it.shape.xy *= vec2(it.offset.x * it.offset.x, it.offset.x);
#endif
    return it;
}

#define AT(row) (corner + ivec2(0, row))
#if CARRIED
#define BEGIN(row) light[row] = imageLoad(target, AT(row)); ray[row] = ray_of(first + vec2(0.0, row));
#else
#define BEGIN(row) light[row] = vec4(0.0); ray[row] = ray_of(first + vec2(0.0, row));
#endif
#define JOIN(row) join(light[row], ray[row], it, row);
#define END(row) imageStore(target, AT(row), light[row]);
#if ROWS == 8
#define EACH(what) what(0) what(1) what(2) what(3) what(4) what(5) what(6) what(7)
#else
#define EACH(what) what(0) what(1) what(2) what(3)
#endif

void main() {
    uint tile = filled[gl_WorkGroupID.x];
    uint at = (tile > 0u ? cursors[last + tile - 1u] : 0u) + skipped;
    uint end = min(cursors[last + tile], at + most);
    ivec2 corner = ivec2(tile % uint(tiles.x), tile / uint(tiles.x)) * ivec2(COLUMNS, ROWS);
    corner += origin + ivec2(gl_LocalInvocationID.x, 0);
    vec2 first = vec2(corner) + 0.5;
    vec4 light[ROWS];
    Ray ray[ROWS];
    EACH(BEGIN)
    for (; at < end; at++) {
        Joined it = read_splat(at, first);
        EACH(JOIN)
#if BLEND == BLEND_COMPOSITE
        float least = min(min(light[0].a, light[1].a), min(light[2].a, light[3].a));
#if ROWS == 8
        least = min(least, min(min(light[4].a, light[5].a), min(light[6].a, light[7].a)));
#endif
        if (least > opaque) break;
#endif
    }
    EACH(END)
}
