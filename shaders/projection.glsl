// Projects a splat: its centre, its reach and the map from pixels to footprint coordinates, by which each pixel computes
// its coordinates without interpolation.
#include "approximations.glsl"
#constant PIXEL_MARGIN  // pixels around a splat: rasterisers snap places to 1/256 of a pixel or finer, and float32 rounds

struct Projected {
    vec4 to_local;   // rows of the matrix from pixel offsets to footprint coordinates, in voxels
    vec2 center;     // in pixels
    float half_side; // of the square around it, in pixels
};

vec2 pixel_of(vec3 v) {
    return frame.image_center + v.xy / (PERSPECTIVE == 1 ? v.z * frame.pixel_pitch : frame.pixel_pitch);
}

// A footprint on a plane parallel to the image: its half axes for a kernel of unit radius, and its reach.
Projected planar_projection(vec3 v, vec3 axis_1, vec3 axis_2, float reach) {
    float pitch = PERSPECTIVE == 1 ? frame.pixel_pitch * v.z : frame.pixel_pitch;
    mat2 local = inverse(mat2(axis_1.xy, axis_2.xy)) * pitch;
    vec2 extent = vec2(length(vec2(axis_1.x, axis_2.x)), length(vec2(axis_1.y, axis_2.y))) * reach / pitch;
    return Projected(vec4(local[0].x, local[1].x, local[0].y, local[1].y), pixel_of(v),
                     max(extent.x, extent.y) + PIXEL_MARGIN);
}

// Perspective, before z_k: D² = |i × U|²/|ray|² for the pixel's ray, both in index axes; i × U is linear in the pixel's
// offset.
Projected near_projection(vec3 v) {
    float pitch = frame.pixel_pitch;
    vec4 to_local;
    mat3 rows = mat3(1.0);
    if (CUBIC == 1) {
        float out_ = length(v.xy);
        vec2 radial = out_ > 0.0 ? v.xy / out_ : vec2(1.0, 0.0);
        to_local = vec4(radial * v.z, vec2(-radial.y, radial.x) * length(v)) * pitch;
    } else {
        vec3 i = to_index(v);
        vec3 right = cross(i, index_from_eye()[0]), down = cross(i, index_from_eye()[1]);
        // the triangular root of the quadratic form right·right x² + 2 right·down x y + down·down y²
        float across = length(right);
        to_local = vec4(across, dot(right, down) / across, 0.0, length(cross(right, down)) / across) * pitch;
        rows = transpose(eye_from_index());
    }
    vec2 ends = max(tangents(v.x, v.z, rows[0], rows[2]), tangents(v.y, v.z, rows[1], rows[2])) / pitch;
    return Projected(to_local, pixel_of(v), max(ends.x, ends.y) + PIXEL_MARGIN);
}

// Projection of a splat in front of the eye.
Projected projected(vec3 v, Quad quad) {
    if (ALIGN == ALIGN_EXACT && !is_widened(v)) return near_projection(v);
    return planar_projection(v, quad.axis_1, quad.axis_2, quad.reach);
}

// Returns whether a splat, widened or not, may reach pixels between edges: left, upper, right and lower slopes, or
// lengths.
bool reaches(vec3 v, vec4 edges) {
    float z = PERSPECTIVE == 1 ? v.z : 1.0;
    vec2 reach = max(frame.support, frame.stretch * z);
    return all(lessThanEqual(edges.xy * z - v.xy, reach)) && all(lessThanEqual(v.xy - edges.zw * z, reach));
}

// Returns whether a splat may be visible; twin of splatgl/splat/culling.py.
bool may_show(vec3 v) {
    return reaches(v, vec4(-frame.edge, frame.edge));
}
