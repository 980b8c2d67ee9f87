// Boxes of voxels, which labels fill evenly: what a pixel's ray passes of them, and their light.
// Depths are those in eye axes, mean spacings; places are in grid steps from frame.base. Twin of splatgl/reference/label_boxes.py.
// switch SHADING 0
// switch CLIPPED 0
// switch LIMITED 0
#include "ellipse.glsl"
#include "light.glsl"
#include "depth_limits.glsl"
#constant FACE       // voxels along a ray behind a cut that are lit as its face
#constant GRAZING_RAY  // see clipping.py
#constant FLUSH
#constant MASK_ZERO  // what a byte holds for components 0 and, beyond it, 1
#constant MASK_ONE
#constant MOST_CLIPS

uniform vec3 box_eye;          // the eye
uniform sampler3D mask_field;  // normals of labels, world axes, in its last components
uniform vec3 normals_low;      // place of the first of them,
uniform float normals_step;    // and voxels to the next
#if CLIPPED == 1
// planes: offsets i from the eye with dot(clip.xyz, i) ≥ clip.w are kept
uniform int clips;
uniform vec4 clip[MOST_CLIPS];
uniform vec3 clip_normal[MOST_CLIPS];  // unit, world
#endif

struct BoxRay {
    vec3 start;      // its place at depth 0
    vec3 direction;  // steps per depth
    vec3 inverse;    // of each component
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
    it.inverse = 1.0 / it.direction;
    it.near = 0.0;
    it.far = 1e18;
    it.stretch = length(along);
    mat3 eye_from_world = mat3(frame.eye_from_world[0].xyz, frame.eye_from_world[1].xyz, frame.eye_from_world[2].xyz);
    it.toward = (along / it.stretch) * eye_from_world;
    it.face = vec4(0.0);
#if CLIPPED == 1
    for (int i = 0; i < clips; i++) {
        float speed = dot(clip[i].xyz, it.direction), apart = clip[i].w - dot(clip[i].xyz, across);
        if (abs(speed) < GRAZING_RAY * length(it.direction)) apart -= FLUSH;
        // a ray along a plane is always or never kept
        float at = apart / (abs(speed) < 1e-18 ? 1e-18 : speed);
        if (speed < 0.0) it.far = min(it.far, at);
        else if (at > it.near) {
            if (at * length(it.direction) > FLUSH) it.face.xyz = clip_normal[i];
            it.near = at;
        }
    }
    it.face.w = it.near + FACE / length(it.direction);
#endif
#if LIMITED == 1
    vec2 drawn = within_depths(vec2(it.near, it.far), ivec2(pixel), 1.0);
    it.near = drawn.x;
    it.far = drawn.y;
#endif
    return it;
}

// Depths at which a ray enters and leaves the box of a voxel; outside it, the first is not less. Neighbours share the
// depths of their faces, bit for bit.
vec2 box_ends(BoxRay it, vec3 place) {
    vec3 a = (place - 0.5 - it.start) * it.inverse, b = (place + 0.5 - it.start) * it.inverse;
    vec3 low = min(a, b), high = max(a, b);
    return vec2(max(max(low.x, low.y), max(low.z, it.near)), min(min(high.x, high.y), min(high.z, it.far)));
}

// The factor of a label's colour, and the highlight, of what a ray passes between two depths.
vec2 box_light(BoxRay it, vec2 ends) {
    if (SHADING == 0 && !CUED) return vec2(1.0, 0.0);
    vec3 place = it.start + it.direction * ends.x, shines = vec3(0.0), normal = vec3(0.0);
    if (LIGHT == 1)
        for (int axis = 0; axis < 3; axis++) shines[axis] = dot(style.light.xyz, frame.eye_from_world[axis].xyz);
    if (SHADING == 1)
        normal = (trilinear(mask_field, (place - normals_low) / normals_step).gba * 255.0 - MASK_ZERO) / MASK_ONE;
    vec2 share = vec2(1.0), unlit = vec2(1.0);
#if CUED
    vec3 cell = cell_at(it.start + it.direction * (0.5 * (ends.x + ends.y)) - box_eye);
    share = reached(cell, normal, it.toward);
    unlit = reached(cell, vec3(0.0), it.toward);
#endif
    vec2 light = surface_light(vec3(0.0), it.toward, shines, unlit);
    // between a voxel's middle and its face, normals of a thin label are half as long as at the face
    light = mix(light, surface_light(normal, it.toward, shines, share), min(2.0 * length(normal), 1.0));
#if CLIPPED == 1
    float faced = clamp((it.face.w - ends.x) / max(ends.y - ends.x, 1e-18), 0.0, 1.0);
    if (SHADING == 1 && it.face.xyz != vec3(0.0)) {
#if CUED
        share = reached(cell, it.face.xyz, it.toward);
#endif
        light = mix(light, surface_light(it.face.xyz, it.toward, shines, share), faced);
    }
#endif
    return light;
}
