// Decodes the words of a splat's record, see splatgl/splat/splats.py.
// switch POINTS 0  records are of points, not of voxels
// switch STEPS 0   parts of a sheet that are classified; 0: splats are classified before
#constant COLOR_SCALE

vec3 in_position;        // grid indices
float in_optical_depth;  // extinction × mean spacing; classified after: the value
vec3 in_color;           // linear RGB; classified after: the gradient, world axes
ivec3 in_normal;         // gradient direction, world axes; zero: unshaded
int in_runs;             // coded run lengths of matter along the grid's axes

// The place in grid indices, from a record's first four words.
vec3 record_position(uvec4 first) {
    if (POINTS == 1) return uintBitsToFloat(first.xyz);
    return vec3(first.x & 0xffffu, first.x >> 16, first.y & 0xffffu);
}

// Sets the record from its words: a voxel's first four and the last two; a point's first, second four, and the last.
void read_words(uvec4 first, uvec4 second, uvec2 rest) {
    in_position = record_position(first);
    uvec2 halves = rest;
    if (POINTS == 1) {
        in_optical_depth = uintBitsToFloat(first.w);
        in_color = uintBitsToFloat(second.xyz);
        halves = uvec2(second.w, rest.x);
    } else if (STEPS > 0) {
        in_optical_depth = uintBitsToFloat(first.z);
        in_color = uintBitsToFloat(uvec3(first.w, rest));
    } else {
        in_optical_depth = uintBitsToFloat(first.w);
        in_color = vec3(first.y >> 16, first.z & 0xffffu, first.z >> 16) / COLOR_SCALE;
    }
    // signed halves
    ivec2 low = ivec2(halves << 16) >> 16, high = ivec2(halves) >> 16;
    in_normal = ivec3(low.x, high.x, low.y);
    in_runs = high.y;
}
