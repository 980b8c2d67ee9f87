// Clips a ray by planes. Twin of splatgl/splat/clipping.py.
#constant MOST_CLIPS
#constant FACE         // voxels along a ray behind a plane that are lit as its face
#constant GRAZING_RAY  // a ray that leaves a plane by less than this share of its length lies in it,
#constant FLUSH        // if it begins within so many voxels of it

uniform int clips;                     // number of planes
uniform vec4 clip[MOST_CLIPS];         // index offsets i from the eye with dot(clip.xyz, i) ≥ clip.w are kept
uniform vec3 clip_normal[MOST_CLIPS];  // unit vector, world axes

// Moves the ends of the ray start + t direction inside the planes; returns the normal of the plane at which it then
// begins, or 0. start: from the eye, index axes. speed: length of direction.
vec3 clip_ray(vec3 start, vec3 direction, float speed, inout float near, inout float far) {
    vec3 face = vec3(0.0);
    float unclipped = near;
    for (int k = 0; k < clips; k++) {
        // not k itself: Mesa would repeat the loop MOST_CLIPS times, for each row
        int i = min(k, clips - 1);
        float rate = dot(clip[i].xyz, direction), apart = clip[i].w - dot(clip[i].xyz, start);
        if (abs(rate) < GRAZING_RAY * speed) apart -= FLUSH;
        // a ray along a plane is kept everywhere or nowhere
        float at = apart / (abs(rate) < 1e-20 ? 1e-20 : rate);
        if (rate < 0.0) far = min(far, at);
        else if (at > near) {
            if (at * speed > unclipped * speed + FLUSH) face = clip_normal[i];
            near = at;
        }
    }
    return face;
}
