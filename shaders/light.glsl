// Lights surfaces: voxels, matter by its gradients, faces of clip planes, and meshes. Twin of splatgl/splat/lighting.py.
// switch LIGHT 0  another light than the plain one at the eye
#include "frame.glsl"
#include "cues.glsl" if SKY or SHADOWS else "cues_off.glsl"

// The factor of colours and the highlight of a surface; 1 and 0 for normal 0. normal: of any length, turned to the
// visible side; light: direction to the light, or 0: along the ray; share: of ambient and of direct light.
vec2 surface_light(vec3 normal, vec3 toward, vec3 light, vec2 share) {
    float size2 = dot(normal, normal), inverse_size = inversesqrt(max(size2, 1e-37));
    float seen = dot(normal, toward) * inverse_size, cosine = min(abs(seen), 1.0), power = cosine;
    float unshaded = 1.0 - style.ambient * (1.0 - share.x) - (1.0 - style.ambient) * (1.0 - share.y);
    if (LIGHT == 0)
        return vec2(size2 > 0.0 ? style.ambient * share.x + style.diffuse * cosine * share.y : unshaded, 0.0);
    if (light != vec3(0.0)) {
        vec3 n = normal * (seen < 0.0 ? -inverse_size : inverse_size), between = toward + light;
        cosine = clamp(dot(n, light), 0.0, 1.0);
        power = clamp(dot(n, between) * inversesqrt(max(dot(between, between), 1e-37)), 0.0, 1.0);
    }
    for (int k = 0; k < int(style.sharpness); k++) power *= power;
    if (size2 <= 0.0) return vec2(unshaded, 0.0);
    return vec2(style.ambient * share.x + style.diffuse * cosine * share.y, style.specular * power * share.y);
}
