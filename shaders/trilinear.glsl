// Interpolates fields on cells linearly between centres, in float32: a sampler's weights may have 8 bits only.
// Twin of splatgl/splat/grid.py.
vec4 trilinear(sampler3D field, vec3 place) {
    ivec3 last = textureSize(field, 0) - 1;
    vec3 inside = clamp(place, vec3(0.0), vec3(last));
    ivec3 low = min(ivec3(inside), max(last - 1, 0)), high = min(low + 1, last);
    vec3 part = inside - vec3(low);
    vec4 planes[2];
    for (int i = 0; i < 2; i++) {
        int z = i == 0 ? low.z : high.z;
        vec4 a = mix(texelFetch(field, ivec3(low.xy, z), 0), texelFetch(field, ivec3(high.x, low.y, z), 0), part.x);
        vec4 b = mix(texelFetch(field, ivec3(low.x, high.y, z), 0), texelFetch(field, ivec3(high.xy, z), 0), part.x);
        planes[i] = mix(a, b, part.y);
    }
    return mix(planes[0], planes[1], part.z);
}
