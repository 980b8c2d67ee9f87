// Reads a placed splat and evaluates its share of a pixel, as a quad's varyings and fragment do.
#define VARYING
#define FLAT
#include "footprint_eval.glsl"
#include "tiles.glsl"

uniform usampler2D list;
uniform usampler2D heads;
uniform usampler2D shapes;
uniform usampler2D matters;
uniform usampler2D bends;
uniform usampler2D cubics;
uniform usampler2D mixeds;

struct Joined {
    vec2 offset;         // of the column's first pixel
    vec4 shape;
    vec4 splat;
    bool around;         // whether around the eye; then its position relative to it, index axes
    vec3 place;
    float last;          // coverage, or its place in sheets
    float half_side;
    vec4 bend;
    vec4 cubic;
    vec4 mixed;
};

// the column's first pixel
vec2 first;

// The footprint over its peak, or its integral over F(0), `row` pixels below the first.
float share_at(Joined it, Ray ray, float row) {
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
    return value;
}

Joined read_splat(uint n) {
    ivec2 texel = texel_of(n);
    uvec4 head = texelFetch(heads, texel, 0);
    uvec4 shape = texelFetch(shapes, texel, 0);
    Joined it;
    it.offset = first - uintBitsToFloat(head.xy);
    it.shape = uintBitsToFloat(shape);
    it.place = vec3(uintBitsToFloat(head.xy), FULL ? it.shape.x : it.shape.y);
    if (FULL) {
        it.splat = uintBitsToFloat(texelFetch(matters, texel, 0));
        it.last = it.splat.a;
        it.half_side = uintBitsToFloat(head.w);
        it.around = it.half_side < 0.0;
    } else {
        uvec2 color = uvec2(head.w, shape.w);
        it.splat.rgb = PACKED == 1 ? unpacked_gradient(uvec4(shape.xyz, head.w)) : unpacked_color(color) * style.brightest;
        it.last = it.shape.w;
        it.around = it.shape.x < 0.0;
    }
    if (BENT) {
        it.bend = uintBitsToFloat(texelFetch(bends, texel, 0));
        if (CUBIC == 0) {
            it.cubic = uintBitsToFloat(texelFetch(cubics, texel, 0));
            it.mixed = uintBitsToFloat(texelFetch(mixeds, texel, 0));
        }
    } else it.shape.x *= it.offset.x;
    it.splat.a = uintBitsToFloat(head.z);
    return it;
}

// Sets the variables that footprint_eval.glsl reads.
void choose(Joined it) {
    splat = it.splat;
    bend = it.bend;
    cubic = it.cubic;
    mixed = it.mixed;
    if (BENT && SHEETS == 0) coverage = it.last;
}
