// Twin of mask_ray.glsl without a mask: keeps everything.
void set_mask_ray(int row, vec3 start, vec3 step_) {}

float mask_above(int row, float sheet) {
    return 0.0;
}

bool mask_part(int row, float origin, inout vec2 part, inout float m) {
    return false;
}

vec4 mask_face(int row, float sheet, vec3 gradient) {
    return vec4(0.0);
}
