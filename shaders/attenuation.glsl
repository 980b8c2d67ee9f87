// Attenuates a splat by the share of a pixel that its matter fills, for pixels wider than a voxel: walls, edges, threads
// and dots differ. Twin of splatgl/splat/footprint.py, which explains the formula.
#include "ellipse.glsl"
#include "optics.glsl"
#constant RUN_OCTAVES    // runs are coded as 2^(code · RUN_OCTAVES)
#constant LARGEST_DEPTH  // optical depth at which a column of matter is opaque: ln 245
#constant RIM_START      // rim(T) = T/√(RIM_START + RIM_GROWTH T²): footprints of depth T beyond a voxel's face
#constant RIM_GROWTH
#constant ONSET          // a lone cell's share falls as 1/m − ONSET (m − 1)/m¹⁶
#constant GRAZING        // least component of a direction along which matter is followed

vec3 run_lengths(int runs) {
    return exp2(vec3(runs & 31, (runs >> 5) & 31, (runs >> 10) & 31) * RUN_OCTAVES);
}

// Run length of matter along a direction in index axes, in voxels.
float run_along(vec3 direction, int runs) {
    vec3 through = run_lengths(runs) / max(abs(direction) / max(length(direction), 1e-30), vec3(GRAZING));
    return min(through.x, min(through.y, through.z));
}

// The optical depth that is correct on average after attenuation by m². depth: optical depth per mean spacing;
// i: the voxel relative to the eye, index axes; coverage: 1/m²; runs: coded lengths along the grid's axes.
float filled_depth(float depth, vec3 i, float coverage, float pixel, int runs) {
    mat3 a = eye_from_index();
    vec3 run = run_lengths(runs);
    vec3 m = max(pixel / vec3(length(a[0]), length(a[1]), length(a[2])), vec3(1.0));

    // length of the ray in this matter, in mean spacings
    vec3 along = PERSPECTIVE == 1 ? i / length(a * i) : index_from_eye()[2];
    vec3 through = run / max(abs(along), vec3(GRAZING));
    float layers = min(through.x, min(through.y, through.z));
    float column = depth * layers;

    // the filled share of the pixel, over the two most filled axes
    vec3 beyond = (run - 1.0) / (m + 1.0);
    beyond *= beyond;
    vec3 m4 = m * m * m * m;
    vec3 alone = 1.0 / m - ONSET * (m - 1.0) / (m4 * m4 * m4 * m4);
    vec3 share = 1.0 - (1.0 - alone) / (1.0 + beyond * beyond);
    float filled = share.x * share.y * share.z / min(share.x, min(share.y, share.z));

    // mean opacity of the column, rim included, against its depth
    vec3 wider = 1.0 + column * inversesqrt(RIM_START + RIM_GROWTH * column * column) / run;
    float hidden = one_minus_exp(column) * wider.x * wider.y * wider.z / max(wider.x, max(wider.y, wider.z));
    float left = column > 0.0 ? column * pow(min(hidden / column, 1.0), 1.0 - filled) : 0.0;

    // matter behind opaque matter must not widen matter in front of it
    float stretch = inversesqrt(coverage);
    left = min(left, LARGEST_DEPTH * stretch / max(stretch - 1.0, 1e-6));
    return left / layers;
}
