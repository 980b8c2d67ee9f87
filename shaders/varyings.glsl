// Declares the varyings of a quad: few and packed, as a software rasteriser sets up each for each triangle. VARYING is defined as
// `out` in the vertex shader and `in` in the fragment shader, FLAT as `flat`; both are empty in shaders without
// varyings. Varyings that a program does not need become plain variables that are never read.
// switch HALF_LINE 0  the eye may be inside a kernel
// switch SHEETS 0     sheets that share a splat; 0: splats composite one by one
// switch CARD 0       a graphics card, whose rasteriser snaps corners
#include "motion.glsl"

#if ALIGN == ALIGN_EXACT
#define EXACT_VARYING FLAT VARYING
#else
#define EXACT_VARYING
#endif
#if ALIGN == ALIGN_EXACT && ANTIALIAS && !CUBIC
#define WIDENED_VARYING FLAT VARYING
#else
#define WIDENED_VARYING
#endif
#if ATTENUATION == ATTENUATION_OPACITY
#define OPACITY_VARYING FLAT VARYING
#else
#define OPACITY_VARYING
#endif
#if HALF_LINE
#define HALF_LINE_VARYING FLAT VARYING
#else
#define HALF_LINE_VARYING
#endif
#if MOTION != MOTION_OFF
#define MOTION_VARYING FLAT VARYING
#else
#define MOTION_VARYING
#endif
#if SHEETS
#define SHEETS_VARYING FLAT VARYING
#else
#define SHEETS_VARYING
#endif

// each pixel's place is computed from the quad's plane where interpolation is off: between snapped corners, and in
// perspective between those near the plane through the eye, which are far away on the screen
#define PLACED (CARD || PERSPECTIVE)
#if PLACED
#define PLACED_VARYING FLAT VARYING
#define PLAIN_VARYING
#else
#define PLACED_VARYING
#define PLAIN_VARYING VARYING
#endif

PLAIN_VARYING vec2 at;                 // footprint coordinates, voxels; for streaks, see passing
PLACED_VARYING vec3 place_middle;        // of quad_place: the quad's middle, eye axes
PLACED_VARYING vec3 place_normal;       // of its plane
PLACED_VARYING vec3 place_row_1;
PLACED_VARYING vec3 place_row_2;
FLAT VARYING vec4 splat;               // linear RGB, shaded; optical depth at the centre, or opacity
OPACITY_VARYING float coverage;        // 1/m² [M98 Eq. 6]
EXACT_VARYING vec4 bend;               // see Quad
WIDENED_VARYING vec4 cubic;
WIDENED_VARYING vec4 mixed;
SHEETS_VARYING vec4 sheet_shares;      // of the sheets that share it, nearest first
HALF_LINE_VARYING vec4 center;         // the voxel relative to the eye, see to_index; w is 1 if around the eye
MOTION_VARYING vec3 path_center;       // the middle of a streak's path, eye axes
MOTION_VARYING vec2 path_step;         // Streak's move; 0 for still splats
MOTION_VARYING vec3 path_isolation;    // isolation, see dwelt_opacity, and Inner's shrink
MOTION_VARYING vec3 inner_x;           // Inner's axes
MOTION_VARYING vec3 inner_y;
