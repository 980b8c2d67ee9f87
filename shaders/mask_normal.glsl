// Reads the normals of a mask's faces or of labels from a texture of bytes.
#constant MASK_ZERO  // byte of a component 0
#constant MASK_ONE   // bytes per 1 beyond it
uniform sampler3D mask_field;  // of each voxel the mask, and the smoothed gradient of it or the label's normal, world axes

vec3 normal_in(vec4 texel) {
    return (texel.gba * 255.0 - MASK_ZERO) / MASK_ONE;
}
