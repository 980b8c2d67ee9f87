// Decodes a splat of a web page from a texel, see splatgl/splat/quantized.py. Twin of records.glsl.
#constant QUANTIZED_ROW  // texels in a row of the texture of splats
#constant CLASSES        // entries of a layer's table
#constant SHARE_STEPS    // steps of a share of optical depth in an octave, and the step of 1
#constant SHARE_ONE

uniform usampler2D quantized_splats;  // positions x, y, z in steps, and the value; normal, share, size, layer; own colour
uniform sampler2D class_table;        // a row per layer, ascending values: linear RGB, optical depth per mean spacing
uniform float position_step;          // of positions, in cells of the grid

vec3 in_position;        // grid indices
float in_optical_depth;  // extinction × mean spacing, over the splat's size
vec3 in_color;           // linear RGB
ivec3 in_normal;         // gradient direction, world axes; zero: unshaded
const int in_runs = 0;

// IEC 61966-2-1
vec3 linear_from_srgb(vec3 c) {
    return mix(c / 12.92, pow((c + 0.055) / 1.055, vec3(2.4)), step(0.04045, c));
}

// A direction from its place on an unfolded octahedron, two bytes around 128; two zero bytes: none.
ivec3 octahedral_normal(uvec2 bytes) {
    if (bytes == uvec2(0u)) return ivec3(0);
    vec2 f = (vec2(bytes) - 128.0) / 127.0;
    vec3 n = vec3(f, 1.0 - abs(f.x) - abs(f.y));
    float t = max(-n.z, 0.0);
    n.xy += vec2(n.x >= 0.0 ? -t : t, n.y >= 0.0 ? -t : t);
    return ivec3(round(normalize(n) * 32767.0));
}

// Sets the record of the splat whose number is the first word.
void read_words(uvec4 first, uvec4 second, uvec2 rest) {
    uvec4 words = texelFetch(quantized_splats, ivec2(first.x % QUANTIZED_ROW, first.x / QUANTIZED_ROW), 0);
    in_position = vec3(words.x & 0xffffu, words.x >> 16, words.y & 0xffffu) * position_step;
    in_normal = octahedral_normal(uvec2(words.z & 0xffu, (words.z >> 8) & 0xffu));
    float share = exp2((float(SHARE_ONE) - float((words.z >> 16) & 0xffu)) / float(SHARE_STEPS));
    splat_size = exp2(float((words.z >> 24) & 0x7u));
    int layer = int(words.z >> 27);
    float place = float(words.y >> 16) / 65535.0 * float(CLASSES - 1);
    int entry = min(int(place), CLASSES - 2);
    vec4 matter = mix(texelFetch(class_table, ivec2(entry, layer), 0),
                      texelFetch(class_table, ivec2(entry + 1, layer), 0), place - float(entry));
    in_color = (words.w >> 24) > 0u ? linear_from_srgb(vec3(words.w & 0xffu, (words.w >> 8) & 0xffu, (words.w >> 16) & 0xffu) / 255.0)
                                    : matter.rgb;
    // a maximum is that of voxels
    in_optical_depth = matter.a * share * (PEAK == 1 ? 1.0 : splat_size);
}
