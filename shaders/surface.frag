// Draws the light and depth of the nearest surfaces between two depths.
// switch PERSPECTIVE 1  0: a parallel view
// switch TEXTURED 0  1: colours by place, which are not lit
#include "light.glsl"
#include "mesh_maps.glsl"
#include "mesh_texture.glsl" if TEXTURED else "mesh_texture_off.glsl"
uniform sampler2D nearest_depth;
uniform sampler2D farthest_depth;
uniform vec2 depths;                  // nearest and farthest of all triangles
uniform bool lit;

in vec3 place;
in vec3 normal;
in vec4 color;
in vec2 value;
layout(location = 0) out vec4 light;  // linear, premultiplied
layout(location = 1) out vec4 depth;  // eye axis, mean spacings

// Logarithms of depths are as fine at the farthest surface as at the nearest: with triangles behind the eye, the
// quotient that the rasteriser interpolates is 1 from a hundredth before the farthest depth on.
float buffer_depth() {
    if (PERSPECTIVE == 0) return (place.z - depths.x) / (depths.y - depths.x);
    return log2(place.z / depths.x) / log2(depths.y / depths.x);
}

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    // a surface that was drawn is not drawn again, whatever its depth's last digits are
    if (place.z <= texelFetch(nearest_depth, pixel, 0).r * (1.0 + 1e-6)) discard;
    if (place.z >= texelFetch(farthest_depth, pixel, 0).r) discard;
    vec4 paint = mesh_paint(value, color.rgb);
    if (paint.a < 0.5) discard;
    vec3 ray = PERSPECTIVE == 1 ? normalize(place) : vec3(0.0, 0.0, 1.0);
    vec2 shine = lit ? surface_light(normal, ray, style.light.xyz, vec2(1.0)) : vec2(1.0, 0.0);
    light = vec4(paint.rgb * shine.x + shine.y, 1.0) * color.a;
    depth = vec4(place.z);
    gl_FragDepth = buffer_depth();
}
