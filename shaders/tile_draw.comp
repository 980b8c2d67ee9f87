// Composites tiles: each invocation blends its tile's list into one column of pixels, front to back.
// switch CARRIED 0
#constant LANES  // invocations of a group
layout(local_size_x = LANES) in;
#define VARYING
#define FLAT
#include "footprint_eval.glsl"
#include "tiles.glsl"

layout(std430, binding = 2) readonly buffer Lists { uvec4 lists[]; };      // tile, begin, end
layout(std430, binding = 3) buffer Open { uint open[]; };                  // tiles that have not terminated
layout(rgba32f, binding = 0) uniform image2D target;
uniform usampler2D list;
uniform usampler2D heads;
uniform usampler2D shapes;
uniform usampler2D matters;
uniform usampler2D bends;
uniform usampler2D cubics;
uniform usampler2D mixeds;
uniform float opaque;    // opacity at which a tile terminates

// A splat to blend: the counterpart of a quad's varyings.
struct Joined {
    vec2 offset;         // of the column's first pixel
    vec4 shape;
    vec4 splat;
    bool around;         // whether around the eye; then its position relative to it, index axes
    vec3 place;
    float coverage;
    float half_side;
    vec4 bend;
    vec4 cubic;
    vec4 mixed;
};

// the column's first pixel
vec2 first;

void join(inout vec4 light, Ray ray, Joined it, float row) {
    vec2 offset = it.offset + vec2(0.0, row);
    float value;
    if (BENT) {
        value = exact_share(vec2(dot(it.shape.xy, offset), dot(it.shape.zw, offset)), ray.shrink, ray);
        // a stretched footprint is undefined far beyond its rim
        if (max(abs(offset.x), abs(offset.y)) > it.half_side) value = 0.0;
    } else {
        // t.x x is constant along the column
        float along = it.shape.x + offset.y * it.shape.y, across = offset.y * it.shape.z;
        value = radial((along * along + across * across) * ray.shrink) * ray.gain;
    }
    if (HALF_LINE == 1 && it.around) value = half_line(it.place, ray_at(first + vec2(0.0, row)));
    value = blended(splat.a * value);
    if (JOIN == JOIN_MAX) {
        light = max(light, vec4(splat.rgb, 1.0) * value);
        return;
    }
    if (JOIN == JOIN_OVER) value *= 1.0 - light.a;
    light += vec4(splat.rgb, 1.0) * value;
}

Joined read_splat(uint n) {
    ivec2 texel = texel_of(n);
    uvec4 head = texelFetch(heads, texel, 0);
    uvec4 shape = texelFetch(shapes, texel, 0);
    Joined it;
    it.offset = first - uintBitsToFloat(head.xy);
    it.shape = uintBitsToFloat(shape);
    it.place = vec3(uintBitsToFloat(head.xy), BENT ? it.shape.x : it.shape.y);
    if (BENT) {
        it.splat = uintBitsToFloat(texelFetch(matters, texel, 0));
        it.coverage = it.splat.a;
        it.half_side = uintBitsToFloat(head.w);
        it.around = it.half_side < 0.0;
        it.bend = uintBitsToFloat(texelFetch(bends, texel, 0));
        if (CUBIC == 0) {
            it.cubic = uintBitsToFloat(texelFetch(cubics, texel, 0));
            it.mixed = uintBitsToFloat(texelFetch(mixeds, texel, 0));
        }
    } else {
        it.splat = vec4(unpacked_color(uvec2(head.w, shape.w)) * style.brightest, 0.0);
        it.around = it.shape.x < 0.0;
        it.shape.x *= it.offset.x;
    }
    it.splat.a = uintBitsToFloat(head.z) * (JOIN == JOIN_OVER ? QUICK_SCALE : 1.0);
    return it;
}

// Sets the variables that footprint_eval.glsl reads.
void choose(Joined it) {
    splat = it.splat;
    bend = it.bend;
    cubic = it.cubic;
    mixed = it.mixed;
    if (BENT) coverage = it.coverage;
}

#define AT(row) (corner + ivec2(0, row))
#define BEGIN(row) \
    light[row] = CARRIED == 1 ? imageLoad(target, AT(row)) : vec4(0.0); ray[row] = ray_of(first + vec2(0.0, row));
#define ADD_SPLAT(row) join(light[row], ray[row], it, row);
#define JOIN_ALL(splat_) { Joined it = splat_; choose(it); EACH(ADD_SPLAT) }
#define END(row) imageStore(target, AT(row), light[row]);
#define EACH(what) what(0) what(1) what(2) what(3) what(4) what(5) what(6) what(7)

void main() {
    uvec4 mine = lists[gl_WorkGroupID.x];
    uint tile = mine.x, at = mine.y, end = mine.z;
    ivec2 corner = ivec2(tile % uint(tiles.x), tile / uint(tiles.x)) * ivec2(COLUMNS, ROWS);
    corner += origin + ivec2(gl_LocalInvocationID.x, 0);
    first = vec2(corner) + 0.5;
    vec4 light[ROWS];
    Ray ray[ROWS];
    EACH(BEGIN)
    // equal for all splats unless bent: only parallel views use this path with antialiasing
    coverage = table_quad(vec3(0.0)).coverage;
    vec2 scale = 1.0 / vec2(textureSize(list, 0));
    float least = 0.0;
    for (; at < end; at += 4u) {
        uvec4 four = textureGather(list, (vec2(listed_at(at)) + 1.0) * scale);
        // all four are read before the first is blended, to hide latency; beyond the list's end the first repeats with
        // zero depth
        Joined next[4];
        next[0] = read_splat(four.w);
        next[1] = read_splat(at + 1u < end ? four.z : four.w);
        next[2] = read_splat(at + 2u < end ? four.x : four.w);
        next[3] = read_splat(at + 3u < end ? four.y : four.w);
        if (at + 1u >= end) next[1].splat.a = 0.0;
        if (at + 2u >= end) next[2].splat.a = 0.0;
        if (at + 3u >= end) next[3].splat.a = 0.0;
        JOIN_ALL(next[0])
        JOIN_ALL(next[1])
        JOIN_ALL(next[2])
        JOIN_ALL(next[3])
        least = min(min(min(light[0].a, light[1].a), min(light[2].a, light[3].a)),
                    min(min(light[4].a, light[5].a), min(light[6].a, light[7].a)));
        if (JOIN == JOIN_OVER && least > opaque) break;
    }
    EACH(END)
    if (JOIN != JOIN_OVER || least <= opaque) open[tile] = 1u;
}
