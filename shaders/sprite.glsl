// A splat as one square of pixels around its centre, in place of a quad: the fragment shader gets from the pixel
// to the place in the footprint by itself, so that one vertex does for four and nothing is interpolated.
#include "exact.glsl"
#include "footprint.glsl"

// pixels added to a sprite's side: rasterisers snap places to 1/256 of a pixel or finer
#define SPRITE_MARGIN 0.03125

struct Sprite {
    vec4 to_local;   // rows of the matrix from pixels off the centre to the place in the footprint, in voxels
    vec2 center;     // in pixels
    float size;      // side in pixels
};

#if SPRITE
vec2 pixel_of(vec3 v) {
#if PERSPECTIVE
    return frame.image_center + v.xy / (v.z * frame.pixel_pitch);
#else
    return frame.image_center + v.xy / frame.pixel_pitch;
#endif
}

// A footprint on a plane parallel to the image: its half axes for a kernel of unit radius, and its reach.
Sprite planar_sprite(vec3 v, vec3 axis_1, vec3 axis_2, float reach) {
#if PERSPECTIVE
    float pitch = frame.pixel_pitch * v.z;
#else
    float pitch = frame.pixel_pitch;
#endif
    mat2 local = inverse(mat2(axis_1.xy, axis_2.xy)) * pitch;
    vec2 extent = vec2(length(vec2(axis_1.x, axis_2.x)), length(vec2(axis_1.y, axis_2.y))) * reach / pitch;
    return Sprite(vec4(local[0].x, local[1].x, local[0].y, local[1].y), pixel_of(v),
                  2.0 * max(extent.x, extent.y) + SPRITE_MARGIN);
}

#if PERSPECTIVE
// Before z_k: D² = |i × U|²/|ray|² for the pixel's ray, both in index axes; i × U is linear in the pixel's offset.
Sprite near_sprite(vec3 v) {
    float step_ = frame.pixel_pitch;
#if CUBIC
    float out_ = length(v.xy);
    vec2 radial = out_ > 0.0 ? v.xy / out_ : vec2(1.0, 0.0);
    vec4 to_local = vec4(radial * v.z, vec2(-radial.y, radial.x) * length(v)) * step_;
    vec3 e1 = vec3(1.0, 0.0, 0.0), e2 = vec3(0.0, 1.0, 0.0), f = vec3(0.0, 0.0, 1.0);
#else
    vec3 i = to_index(v);
    vec3 right = cross(i, index_from_eye()[0]), down = cross(i, index_from_eye()[1]);
    // the triangular root of the form right·right x² + 2 right·down x y + down·down y²
    float across = length(right);
    vec4 to_local = vec4(across, dot(right, down) / across, 0.0, length(cross(right, down)) / across) * step_;
    mat3 rows = transpose(eye_from_index());
    vec3 e1 = rows[0], e2 = rows[1], f = rows[2];
#endif
    float extent = max(furthest(v.x, v.z, e1, f), furthest(v.y, v.z, e2, f)) / step_;
    return Sprite(to_local, pixel_of(v), 2.0 * extent + SPRITE_MARGIN);
}
#endif
#endif
