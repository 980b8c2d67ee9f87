// Attenuation by how much of its pixel a splat's matter fills: what a pixel wider than a voxel shows of a
// wall, an edge, a thread or a dot before it is filtered. Twin of splatgl/splat/fill.py, which explains it.
#define RUN_OCTAVES 0.32    // runs are coded as 2^(code · RUN_OCTAVES)
#define LARGEST_DEPTH 5.5   // optical depth at which a column of matter is opaque: ln 245
#define RIM_START 41.0      // rim(T) = T/√(RIM_START + RIM_GROWTH T²): footprints of depth T beyond a voxel's face
#define RIM_GROWTH 1.1
#define ONSET 2.0           // a lone cell's share falls as 1/m − ONSET (m − 1)/m¹⁶

vec3 run_lengths(int runs) {
    return exp2(vec3(runs & 31, (runs >> 5) & 31, (runs >> 10) & 31) * RUN_OCTAVES);
}

// How far matter goes on along a direction in index axes, in voxels.
float run_along(vec3 direction, int runs) {
    vec3 through = run_lengths(runs) / max(abs(direction) / max(length(direction), 1e-30), vec3(1e-3));
    return min(through.x, min(through.y, through.z));
}

// 1 for a splat that moves by itself, 0 for one in matter that goes on along its path of that length; see dwell.py.
float alone(float size, float through) {
    float follows = max(through - 1.0, 0.0) / (size + 1.0);
    return 1.0 / (1.0 + follows * follows);
}

// depth: optical depth per mean spacing; i: the voxel relative to the eye, index axes; coverage: 1/m²;
// runs: coded lengths along the grid's axes. The depth that attenuation by m² leaves right on average.
float filled_depth(float depth, vec3 i, float coverage, float pixel, int runs) {
    mat3 a = eye_from_index();
    vec3 run = run_lengths(runs);
    vec3 m = max(pixel / vec3(length(a[0]), length(a[1]), length(a[2])), vec3(1.0));

    // how far the ray goes on in this matter, in mean spacings
#if PERSPECTIVE
    vec3 along = i / length(a * i);
#else
    vec3 along = index_from_eye()[2];
#endif
    vec3 through = run / max(abs(along), vec3(1e-3));
    float layers = min(through.x, min(through.y, through.z));
    float column = depth * layers;

    // the share of the pixel that is filled, across the two axes along which it is most
    vec3 beyond = (run - 1.0) / (m + 1.0);
    beyond *= beyond;
    vec3 m4 = m * m * m * m;
    vec3 alone = 1.0 / m - ONSET * (m - 1.0) / (m4 * m4 * m4 * m4);
    vec3 share = 1.0 - (1.0 - alone) / (1.0 + beyond * beyond);
    float filled = share.x * share.y * share.z / min(share.x, min(share.y, share.z));

    // what the column hides on average, rim included, against its depth
    vec3 wider = 1.0 + column * inversesqrt(RIM_START + RIM_GROWTH * column * column) / run;
    float hidden = one_minus_exp(column) * wider.x * wider.y * wider.z / max(wider.x, max(wider.y, wider.z));
    float left = column > 0.0 ? column * pow(min(hidden / column, 1.0), 1.0 - filled) : 0.0;

    // matter behind opaque matter must not widen what is before it
    float stretch = inversesqrt(coverage);
    left = min(left, LARGEST_DEPTH * stretch / max(stretch - 1.0, 1e-6));
    return left / layers;
}
