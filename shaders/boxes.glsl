// Intersects a pixel's ray with the boxes of voxels, which labels fill evenly, and lights them.
// Depths are along the eye's axis, in mean spacings; places are in grid steps from frame.base.
// Twin of splatgl/reference/layers.py.
// switch SHADING 0  normals are lit
// switch CLIPPED 0  planes clip rays
// switch LIMITED 0  meshes limit rays
#include "ellipse.glsl"
#include "light.glsl"
#include "mask_normal.glsl"
#include "trilinear.glsl"
#include "clip_ray.glsl" if CLIPPED else "clip_ray_off.glsl"
#include "depth_limits.glsl" if LIMITED else "depth_limits_off.glsl"

uniform vec3 box_eye;          // the eye
uniform vec3 normals_low;      // place of the first of them,
uniform float normals_step;    // and voxels to the next

struct BoxRay {
    vec3 start;      // its place at depth 0
    vec3 direction;  // steps per depth
    vec3 inverted;   // of each component
    float near;      // depths between which matter is drawn
    float far;
    float stretch;   // lengths per depth
    vec3 toward;     // unit vector, world axes
    vec4 face;       // normal of the plane behind which it begins, and the depth at which its face ends; or 0
};

BoxRay box_ray(vec2 pixel) {
    vec3 slope = vec3((pixel - frame.image_center) * frame.pixel_pitch, 1.0);
    vec3 along = PERSPECTIVE == 1 ? slope : vec3(0.0, 0.0, 1.0);
    vec3 across = PERSPECTIVE == 1 ? vec3(0.0) : index_from_eye() * vec3(slope.xy, 0.0);
    BoxRay it;
    it.start = box_eye + across;
    it.direction = index_from_eye() * along;
    // away from 0: a ray along a face is in one of its two voxels
    it.direction = mix(it.direction, vec3(1e-18), lessThan(abs(it.direction), vec3(1e-18)));
    it.inverted = 1.0 / it.direction;
    it.near = 0.0;
    it.far = 1e18;
    it.stretch = length(along);
    mat3 eye_from_world = mat3(frame.eye_from_world[0].xyz, frame.eye_from_world[1].xyz, frame.eye_from_world[2].xyz);
    it.toward = (along / it.stretch) * eye_from_world;
    float speed = length(it.direction);
    it.face.xyz = clip_ray(across, it.direction, speed, it.near, it.far);
    it.face.w = it.near + FACE / speed;
    vec2 drawn = within_depths(vec2(it.near, it.far), ivec2(pixel), 1.0);
    it.near = drawn.x;
    it.far = drawn.y;
    return it;
}

// Depths at which a ray enters and leaves the box of a voxel; outside it, the first is not less. Neighbours share the
// depths of their faces, bit for bit.
vec2 box_ends(BoxRay it, vec3 place) {
    vec3 a = (place - 0.5 - it.start) * it.inverted, b = (place + 0.5 - it.start) * it.inverted;
    vec3 low = min(a, b), high = max(a, b);
    return vec2(max(max(low.x, low.y), max(low.z, it.near)), min(min(high.x, high.y), min(high.z, it.far)));
}

// The factor of a label's colour, and the highlight, of what a ray passes between two depths.
vec2 box_light(BoxRay it, vec2 ends) {
    if (SHADING == 0 && CUED == 0) return vec2(1.0, 0.0);
    vec3 place = it.start + it.direction * ends.x, shines = vec3(0.0), normal = vec3(0.0);
    if (LIGHT == 1)
        for (int axis = 0; axis < 3; axis++) shines[axis] = dot(style.light.xyz, frame.eye_from_world[axis].xyz);
    if (SHADING == 1)
        normal = normal_in(trilinear(mask_field, (place - normals_low) / normals_step));
    vec3 cell = cell_at(it.start + it.direction * (0.5 * (ends.x + ends.y)) - box_eye);
    vec2 share = reached(cell, normal, it.toward), unlit = reached(cell, vec3(0.0), it.toward);
    vec2 light = surface_light(vec3(0.0), it.toward, shines, unlit);
    // between a voxel's middle and its face, normals of a thin label are half as long as at the face
    light = mix(light, surface_light(normal, it.toward, shines, share), min(2.0 * length(normal), 1.0));
    float faced = clamp((it.face.w - ends.x) / max(ends.y - ends.x, 1e-18), 0.0, 1.0);
    if (CLIPPED == 1 && SHADING == 1 && it.face.xyz != vec3(0.0)) {
        share = reached(cell, it.face.xyz, it.toward);
        light = mix(light, surface_light(it.face.xyz, it.toward, shines, share), faced);
    }
    return light;
}
