// Declares the two uniform blocks: Frame changes with the view, Style with the scene.
// Lengths are in mean voxel spacings; eye axes are right, down, forward.

layout(std140) uniform Frame {
    vec4 eye_from_index[3];  // columns of A in eye axes: x, y, z steps of the grid
    vec4 index_from_eye[3];  // and of its inverse
    vec4 eye_from_world[3];  // columns of the rotation, for normals
    vec4 base;               // the voxel nearest to the eye, grid indices: exact when subtracted from a position
    vec4 eye_from_base;      // from there to the eye, eye axes
    vec2 clip_scale;         // clip units per slope (perspective) or per length (orthographic)
    float pixel_pitch;       // a pixel's side at depth 1 (perspective) or everywhere (orthographic)
    float switch_depth;      // z_s: grid-aligned from here on
    float near;              // near clipping depth
    float depth_reach;       // half extent of a kernel in depth
    vec2 image_center;       // in pixels: a pixel's slope is (gl_FragCoord − image_center) pixel_pitch
    vec2 beyond;             // depths from which antialiasing widens a voxel's wider and narrower side
    vec2 edge;               // slopes, or lengths, from the middle of the picture to its edges
    vec2 support;            // reach of a kernel beyond the planes through them,
    vec2 stretch;            // and of a widened one at depth 1
    vec4 first_from_index[3];  // motion: as eye_from_index and eye_from_base, when the shutter opens …
    vec4 last_from_index[3];
    vec4 first_from_base;      // … and closes
    vec4 last_from_base;
    float line;                // W: the footprint's integral along a line through its centre
    float weaken;              // a streak of length l is weaker by 1 + l · weaken
    float blur;                // pixels below which antialiasing leaves no half axis
} frame;

layout(std140) uniform Style {
    float radius;         // R, the kernel's support
    float peak;           // F(0); the table holds F/F(0)
    float opacity_length; // reference length of opacities
    float ambient;        // shading: C = c (ambient + diffuse |n·l|)
    float diffuse;
    float radial_scale;   // texels of the radial table a squared voxel
    float radial_last;    // its last texel, which holds 0
    float brightest;      // the largest colour component, 1 or more
    float specular;       // highlights: a power, 2^sharpness, of a cosine
    float sharpness;
    vec4 light;           // where the light shines, eye axes, and 1; or 0: along each ray
} style;
