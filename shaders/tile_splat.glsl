// Reads a placed splat and evaluates its share of a pixel, as a quad's varyings and fragment do.
#define VARYING
#define FLAT
#include "footprint_eval.glsl"
#include "tiles.glsl"

uniform usampler2D list;
// a processor reads an image in half the instructions of a texel
#if CARD == 1 || COMPUTE == 0
#define TEXEL(name, at) texelFetch(name, at, 0)
uniform usampler2D heads;
uniform usampler2D shapes;
#else
#define TEXEL(name, at) imageLoad(name, at)
layout(rgba32ui, binding = 1) readonly uniform uimage2D heads;
layout(rgba32ui, binding = 2) readonly uniform uimage2D shapes;
#endif
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
    } else {
        // t.x x is constant along the column
        float along = it.shape.x + offset.y * it.shape.y, across = offset.y * it.shape.z;
        value = radial((along * along + across * across) * ray.shrink) * ray.gain;
    }
    if (HALF_LINE == 1 && it.around) value = half_line(it.place, ray_at(first + vec2(0.0, row)));
    return value;
}

// Reads a splat's texels. head: centre, value or depth, half a side; matter: colour or gradient, and coverage or its
// place in sheets.
void read_texels(uint n, out vec4 head, out vec4 shape, out vec4 matter) {
    ivec2 texel = texel_of(n);
    uvec4 words = TEXEL(heads, texel), others = TEXEL(shapes, texel);
    head = uintBitsToFloat(words);
    shape = uintBitsToFloat(others);
    if (FULL) matter = uintBitsToFloat(texelFetch(matters, texel, 0));
    else {
        vec3 color = unpacked_color(uvec2(words.w, others.w)) * style.brightest;
        matter = vec4(PACKED == 1 ? unpacked_gradient(uvec4(others.xyz, words.w)) : color, shape.w);
    }
}

// The splat of these texels, without the terms of a bent one.
Joined joined(vec4 head, vec4 shape, vec4 matter) {
    Joined it;
    it.offset = first - head.xy;
    it.shape = shape;
    it.place = vec3(head.xy, FULL ? shape.x : shape.y);
    it.around = (FULL ? head.w : shape.x) < 0.0;
    it.splat = vec4(matter.rgb, head.z);
    it.last = matter.a;
    if (!BENT) it.shape.x *= it.offset.x;
    return it;
}

Joined read_splat(uint n) {
    vec4 head, shape, matter;
    read_texels(n, head, shape, matter);
    Joined it = joined(head, shape, matter);
    if (BENT) {
        ivec2 texel = texel_of(n);
        it.bend = uintBitsToFloat(texelFetch(bends, texel, 0));
        if (CUBIC == 0) {
            it.cubic = uintBitsToFloat(texelFetch(cubics, texel, 0));
            it.mixed = uintBitsToFloat(texelFetch(mixeds, texel, 0));
        }
    }
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
