// Twin of clip_ray.glsl without planes: changes nothing.
#constant FACE
vec3 clip_ray(vec3 start, vec3 direction, float speed, inout float near, inout float far) {
    return vec3(0.0);
}
