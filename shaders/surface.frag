// The nearest surfaces behind a depth, and before another: light and depth.
// switch PERSPECTIVE 1
#constant MAP_ENTRIES
#constant KNOWN        // places in a map below which there is no value
#include "light.glsl"
uniform sampler2D maps;  // rows of linear RGB
uniform sampler2D nearest_depth;
uniform sampler2D farthest_depth;
uniform bool lit;

in vec3 place;
in vec3 normal;
in vec4 color;
in vec2 value;
layout(location = 0) out vec4 light;  // linear, premultiplied
layout(location = 1) out vec4 depth;

// Linear RGB; twin of splatgl/splat/classification/mesh_colors.py.
vec3 own_color() {
    if (value.y < -0.5 || value.x < KNOWN) return color.rgb;
    float at = clamp(value.x, 0.0, 1.0) * float(MAP_ENTRIES - 1);
    int low = min(int(at), MAP_ENTRIES - 2), row = int(value.y + 0.5);
    return mix(texelFetch(maps, ivec2(low, row), 0).rgb, texelFetch(maps, ivec2(low + 1, row), 0).rgb, at - float(low));
}

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    // a surface that was drawn is not drawn again, whatever its depth's last digits are
    if (place.z <= texelFetch(nearest_depth, pixel, 0).r * (1.0 + 1e-6)) discard;
    if (place.z >= texelFetch(farthest_depth, pixel, 0).r) discard;
    vec3 ray = PERSPECTIVE == 1 ? normalize(place) : vec3(0.0, 0.0, 1.0);
    vec2 shine = lit ? surface_light(normal, ray, style.light.xyz, vec2(1.0)) : vec2(1.0, 0.0);
    light = vec4(own_color() * shine.x + shine.y, 1.0) * color.a;
    depth = vec4(place.z);
}
