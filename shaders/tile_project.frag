// Places splats in drawing order, one per texel of the output textures, which hold what a quad's varyings hold.
// switch ORDERED 1  records are read in the order of a texture
// switch CULLED 0   only visible blocks are placed
// version 430 if COMPUTE
#define VARYING
#define FLAT
#include "splat_setup.glsl"
#include "projection.glsl"
#include "sheets.glsl"
#include "tiles.glsl"
#constant BLOCK      // splats that are left out together
#constant HAS_PLACE  // a kernel nearer to the eye's plane than this many of its reaches has no place in the picture

uniform usampler2D records;   // the first four words; of points eight, in two texels
uniform usampler2D rest;      // the last two; of points the last
uniform usampler2D order;     // indices of records
uniform uint first;           // range of the drawing order, end exclusive
uniform uint end;
uniform float reach;          // share of a footprint's radius within which it is drawn for certain
uniform usampler2D blocks;    // visible blocks of the drawing order

layout(location = 0) out uvec4 bounds;
layout(location = 1) out uvec4 head;
layout(location = 2) out uvec4 shape;
layout(location = 3) out uvec4 matter;
layout(location = 4) out uvec4 out_bend;
layout(location = 5) out uvec4 out_cubic;
layout(location = 6) out uvec4 out_mixed;

void read_record(uint n) {
    ivec2 at = texel_of(n), four = at * ivec2(1 + POINTS, 1);
    uvec4 second = POINTS == 1 ? texelFetch(records, four + ivec2(1, 0), 0) : uvec4(0u);
    read_words(texelFetch(records, four, 0), second, texelFetch(rest, at, 0).rg);
}

// The largest root of a footprint's form within the square around it. Nearer than z_k, the form is D² times the square of
// the pixel's ray, which is longest at a corner; further, the square fits.
float form_radius(vec3 v, vec2 center, float half_side, vec3 t) {
    if (ALIGN != ALIGN_EXACT || PERSPECTIVE == 0 || is_widened(v))
        return (half_side - PIXEL_MARGIN) / max(length(vec2(t.y / t.z, 1.0) / t.x), 1.0 / t.z);
    vec2 low = clamp(center - half_side, vec2(0.0), 2.0 * frame.image_center) - frame.image_center;
    vec2 high = clamp(center + half_side, vec2(0.0), 2.0 * frame.image_center) - frame.image_center;
    vec4 ends = vec4(low, high) * frame.pixel_pitch;
    float longest = max(max(length(to_index(vec3(ends.xy, 1.0))), length(to_index(vec3(ends.zy, 1.0)))),
                        max(length(to_index(vec3(ends.xw, 1.0))), length(to_index(vec3(ends.zw, 1.0)))));
    return style.radius * longest;
}

void main() {
    ivec2 at = ivec2(gl_FragCoord.xy);
    uint n = uint(at.y) * ABREAST + uint(at.x);
    bool drawn = true;
    if (CULLED == 1) {
        n = texelFetch(blocks, texel_of(n / BLOCK), 0).r * BLOCK + n % BLOCK;
        drawn = n >= first && n < end;
    } else n += first;
    if (ORDERED == 1) n = texelFetch(order, texel_of(n), 0).r;
    read_record(n);
    vec3 v = eye_from_index() * (in_position - frame.base.xyz) - frame.eye_from_base.xyz;
    Quad quad = splat_quad(v);
    Projected it = projected(v, quad);
    give_matter(v, quad);
    // culls each splat too far beyond the edge, besides whole blocks
    drawn = drawn && may_show(v);
    bool around = ALIGN == ALIGN_EXACT && v.z <= HAS_PLACE * frame.depth_reach;
    float half_side = drawn && !around ? it.half_side : UNSEEN;
    vec3 triangle = triangle_of(it.to_local);
    Extent extent = extent_of(triangle, reach * form_radius(v, it.center, half_side, triangle));
    vec2 words = packed_extent(extent);
    // where it is wider than a picture can be
    float middle = it.center.x;
#if COMPUTE
    if (unpacked_extent(words).width >= 65504.0) middle = frame.image_center.x;
#endif
    bounds = floatBitsToUint(vec4(middle, it.center.y, half_side > 0.0 ? words.x : UNSEEN, words.y));
    head = floatBitsToUint(vec4(it.center, splat.a, half_side));
    shape = floatBitsToUint(it.to_local);
    matter = floatBitsToUint(vec4(splat.rgb, coverage));
    out_bend = floatBitsToUint(bend);
    out_cubic = floatBitsToUint(cubic);
    out_mixed = floatBitsToUint(mixed);
    if (SHEETS > 0) matter.w = floatBitsToUint(sheet_place(in_position));
    if (!BENT) shape = uvec4(floatBitsToUint(triangle), 0u);
    if (!FULL && PACKED == 0) {
        uvec2 color = packed_color(splat.rgb / style.brightest);
        head.w = color.x;
        shape.w = color.y;
    }
    if (HALF_LINE == 1 && around && drawn && v.z > -frame.depth_reach) {
        // in every tile; stores its position instead of the centre, and AROUND instead of a half side or triangle
        vec3 i = to_index(v);
        bounds = floatBitsToUint(vec4(frame.image_center, packed_extent(Extent(EVERYWHERE, EVERYWHERE, 0.0))));
        head.xy = floatBitsToUint(i.xy);
        if (FULL) {
            head.w = floatBitsToUint(AROUND);
            shape.x = floatBitsToUint(i.z);
        } else shape.xy = floatBitsToUint(vec2(AROUND, i.z));
    }
    if (BOXES == 1) {
        head = floatBitsToUint(vec4(in_position - frame.base.xyz, splat.a));
        shape = floatBitsToUint(vec4(splat.rgb, 0.0));
    }
    if (PACKED == 1) {
        uvec4 words = packed_gradient(splat.rgb, shape.xyz);
        shape = uvec4(words.xyz, matter.w);
        head.w = words.w;
    }
}
