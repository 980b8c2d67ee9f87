// Colours a mesh by the texels of its texture, as splatgl.data.mesh.Texture describes them.
uniform sampler2D texels;     // linear RGB and 1 or 0, or places in a map
uniform bool mapped;          // whether they are places
uniform bool smooth_texels;   // whether cubics lie between them
uniform int map_row;          // of the colour map

bool is_hole(vec4 texel) {
    return mapped ? texel.r < KNOWN : texel.a < 0.5;
}

// Weights of the texels at -1, 0, 1 and 2 for a place from 0 to 1. [Keys 1981, a = -1/2]
vec4 keys_weights(float t) {
    return vec4(((2.0 - t) * t - 1.0) * t / 2.0, (3.0 * t - 5.0) * t * t / 2.0 + 1.0,
                ((4.0 - 3.0 * t) * t + 1.0) * t / 2.0, (t - 1.0) * t * t / 2.0);
}

// The texel at a column and row; a hole has the texel `middle`.
vec4 texel_at(ivec2 at, vec4 middle) {
    vec4 texel = texelFetch(texels, clamp(at, ivec2(0), textureSize(texels, 0) - 1), 0);
    return is_hole(texel) ? middle : texel;
}

// Linear RGB, and 1, or 0 in a hole. place: column and row, whole numbers at the texels' centres.
vec4 mesh_paint(vec2 place, vec3 plain) {
    ivec2 last = textureSize(texels, 0) - 1;
    vec4 middle = texelFetch(texels, clamp(ivec2(floor(place + 0.5)), ivec2(0), last), 0);
    if (is_hole(middle)) return vec4(0.0);
    vec4 paint = middle;
    if (smooth_texels) {
        ivec2 low = ivec2(floor(place));
        vec4 across = keys_weights(place.x - float(low.x)), down = keys_weights(place.y - float(low.y));
        paint = vec4(0.0);
        for (int j = 0; j < 4; j++) {
            for (int i = 0; i < 4; i++) paint += across[i] * down[j] * texel_at(low + ivec2(i, j) - 1, middle);
        }
    }
    if (mapped) return vec4(mapped_color(vec2(paint.r, float(map_row)), plain), 1.0);
    return vec4(max(paint.rgb, 0.0), 1.0);
}
