// Colours the values of meshes. Twin of splatgl/splat/colormaps.py.
#constant MAP_ENTRIES
#constant KNOWN          // places in a map below which there is no value
uniform sampler2D maps;  // rows of linear RGB

// Linear RGB of a value: its place from 0 to 1 in a map, and the map's row; `plain` without a map or a value.
vec3 mapped_color(vec2 value, vec3 plain) {
    if (value.y < -0.5 || value.x < KNOWN) return plain;
    float at = clamp(value.x, 0.0, 1.0) * float(MAP_ENTRIES - 1);
    int low = min(int(at), MAP_ENTRIES - 2), row = int(value.y + 0.5);
    return mix(texelFetch(maps, ivec2(low, row), 0).rgb, texelFetch(maps, ivec2(low + 1, row), 0).rgb, at - float(low));
}
