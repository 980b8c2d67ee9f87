// Light of surfaces: of matter by its gradients, of cuts, and of meshes. Twin of splatgl/splat/classification/shading.py.
#include "frame.glsl"
// Light that a surface with that normal, of any length, shows; 1 without one.
float surface_light(vec3 normal, vec3 toward) {
    float size2 = dot(normal, normal);
    float cosine = min(abs(dot(normal, toward)) * inversesqrt(max(size2, 1e-37)), 1.0);
    return size2 > 0.0 ? style.ambient + style.diffuse * cosine : 1.0;
}
