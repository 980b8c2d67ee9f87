// Draws tiles: an invocation adds up all splats of its tile's list for one column of pixels, nearest first.
// switch CARRIED 0
layout(local_size_x = 8) in;
#define VARYING
#define FLAT
#include "value.glsl"
#include "footprint.glsl"
#include "tiles.glsl"

layout(std430, binding = 2) readonly buffer Lists { uvec4 lists[]; };      // tile, begin, end
layout(std430, binding = 3) buffer Open { uint open[]; };                  // tiles that light still passes
layout(rgba32f, binding = 0) uniform image2D target;
uniform usampler2D list;
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
uniform float opaque;    // a tile of pixels that hide more gets no more

#if BENT
#define RAY Ray
#define RAY_OF ray_of
#else
// What all splats have of a pixel's ray: D² over the quadratic form, and the integral over F.
struct Plain {
    float shrink;
    float gain;
};
#define RAY Plain
#define RAY_OF plain_of

Plain plain_of(vec2 pixel_center) {
    Ray ray = ray_of(pixel_center);
#if ALIGN == ALIGN_EXACT && !CUBIC && BLEND != BLEND_MIP
    return Plain(1.0 / ray.across2, ray.length_ * inversesqrt(ray.across2));
#else
    return Plain(1.0 / ray.across2, 1.0);
#endif
}
#endif

// A splat that is joined to the pixels: what a sprite's fragments have of it.
struct Joined {
    vec2 offset;         // of the column's first pixel
    vec4 shape;
    vec4 splat;
#if BENT
    float coverage;
    float half_side;
    vec4 bend;
#if !CUBIC
    vec4 cubic;
    vec4 mixed;
#endif
#endif
};

void join(inout vec4 light, RAY ray, Joined it, float row) {
    vec2 offset = it.offset + vec2(0.0, row);
#if BENT
    float value = splat.a * exact_share(local_place(offset), ray);
    // far beyond its rim a stretched footprint has no meaning
    if (max(abs(offset.x), abs(offset.y)) > it.half_side) value = 0.0;
#else
    // t.x x is the column's
    float along = it.shape.x + offset.y * it.shape.y, across = offset.y * it.shape.z;
    float r2 = along * along + across * across;
    float value = splat.a * radial(r2 * ray.shrink) * ray.gain;
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

Joined read_splat(uint n, vec2 first) {
    ivec2 texel = texel_of(n);
    uvec4 head = texelFetch(heads, texel, 0);
    uvec4 shape = texelFetch(shapes, texel, 0);
    Joined it;
    it.offset = first - uintBitsToFloat(head.xy);
    it.shape = uintBitsToFloat(shape);
#if BENT
    it.splat = uintBitsToFloat(texelFetch(matters, texel, 0));
    it.half_side = uintBitsToFloat(head.w);
    it.bend = uintBitsToFloat(texelFetch(bends, texel, 0));
#if !CUBIC
    it.cubic = uintBitsToFloat(texelFetch(cubics, texel, 0));
    it.mixed = uintBitsToFloat(texelFetch(mixeds, texel, 0));
#endif
#else
    it.splat = vec4(unpackUnorm2x16(head.w), unpackUnorm2x16(shape.w).x, 0.0);
    it.splat.rgb *= style.brightest;
    it.shape.x *= it.offset.x;
#endif
#if BENT
    it.coverage = it.splat.a;
#endif
    it.splat.a = uintBitsToFloat(head.z);
#if BLEND == BLEND_COMPOSITE
    it.splat.a *= QUICK_SCALE;
#endif
    return it;
}

// What value.glsl reads of it.
void choose(Joined it) {
    splat = it.splat;
#if BENT && ATTENUATION == ATTENUATION_OPACITY
    coverage = it.coverage;
#endif
#if BENT
    to_local = it.shape;
    bend = it.bend;
#if !CUBIC
    cubic = it.cubic;
    mixed = it.mixed;
#endif
#endif
}

#define AT(row) (corner + ivec2(0, row))
#if CARRIED
#define BEGIN(row) light[row] = imageLoad(target, AT(row)); ray[row] = RAY_OF(first + vec2(0.0, row));
#else
#define BEGIN(row) light[row] = vec4(0.0); ray[row] = RAY_OF(first + vec2(0.0, row));
#endif
#define JOIN(row) join(light[row], ray[row], it, row);
#define JOIN_ALL(splat_) { Joined it = splat_; choose(it); EACH(JOIN) }
#define END(row) imageStore(target, AT(row), light[row]);
#define EACH(what) what(0) what(1) what(2) what(3) what(4) what(5) what(6) what(7)

void main() {
    uvec4 mine = lists[gl_WorkGroupID.x];
    uint tile = mine.x, at = mine.y, end = mine.z;
    ivec2 corner = ivec2(tile % uint(tiles.x), tile / uint(tiles.x)) * ivec2(COLUMNS, ROWS);
    corner += origin + ivec2(gl_LocalInvocationID.x, 0);
    vec2 first = vec2(corner) + 0.5;
    vec4 light[ROWS];
    RAY ray[ROWS];
    EACH(BEGIN)
#if !BENT && ATTENUATION == ATTENUATION_OPACITY
    // all splats' alike: only parallel views come here with antialiasing
    coverage = splat_quad(vec3(0.0)).coverage;
#endif
    vec2 scale = 1.0 / vec2(textureSize(list, 0));
#if BLEND == BLEND_COMPOSITE
    float least = 0.0;
#endif
    for (; at < end; at += 4u) {
        uvec4 four = textureGather(list, (vec2(listed_at(at)) + 1.0) * scale);
        // all are read before the first is joined, so that none waits; beyond the list's end it is the first again,
        // without its matter
        Joined next[4];
        next[0] = read_splat(four.w, first);
        next[1] = read_splat(at + 1u < end ? four.z : four.w, first);
        next[2] = read_splat(at + 2u < end ? four.x : four.w, first);
        next[3] = read_splat(at + 3u < end ? four.y : four.w, first);
        if (at + 1u >= end) next[1].splat.a = 0.0;
        if (at + 2u >= end) next[2].splat.a = 0.0;
        if (at + 3u >= end) next[3].splat.a = 0.0;
        JOIN_ALL(next[0])
        JOIN_ALL(next[1])
        JOIN_ALL(next[2])
        JOIN_ALL(next[3])
#if BLEND == BLEND_COMPOSITE
        least = min(min(min(light[0].a, light[1].a), min(light[2].a, light[3].a)),
                    min(min(light[4].a, light[5].a), min(light[6].a, light[7].a)));
        if (least > opaque) break;
#endif
    }
    EACH(END)
#if BLEND == BLEND_COMPOSITE
    if (least <= opaque) open[tile] = 1u;
#endif
}
