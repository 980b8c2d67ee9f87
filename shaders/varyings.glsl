// What a quad's corners hand to its fragments: few and packed, since a software rasteriser sets up each of
// them for each triangle. VARYING is defined as `out` in the vertex shader and `in` in the
// fragment shader, FLAT as `flat`; both as nothing where a shader keeps them to itself.
// switch SPRITE 0
#include "motion.glsl"

#if SPRITE
FLAT VARYING vec4 to_local;  // see Sprite
FLAT VARYING vec2 pixel;     // the centre
#else
VARYING vec2 at;           // place in the footprint: [−1, 1]², or for exact quads in voxels; for streaks, see passing
#endif
FLAT VARYING vec4 splat;   // linear RGB, shaded; optical depth, or for mip the opacity, at the centre
#if ATTENUATION == ATTENUATION_OPACITY
FLAT VARYING float coverage;  // 1/m² [M98 Eq. 6]
#else
const float coverage = 1.0;
#endif
#if ALIGN == ALIGN_EXACT
#if ANTIALIAS || !SPRITE
FLAT VARYING vec4 bend;    // see ExactQuad
#endif
#if ANTIALIAS && !CUBIC
FLAT VARYING vec4 cubic;
FLAT VARYING vec4 mixed;
#endif
#if HALF_LINE
FLAT VARYING vec4 center;  // the voxel relative to the eye, index axes (eye axes for cubes); w is 1 if around the eye
#endif
#endif
#if MOTION != MOTION_OFF
FLAT VARYING vec3 heart;   // the middle of a streak's path, eye axes
FLAT VARYING vec2 move;    // Streak's step; 0 for what stands still
FLAT VARYING vec2 shrink;  // see Inner
#if !CUBIC
FLAT VARYING vec3 inner_x;
FLAT VARYING vec3 inner_y;
#endif
#if ATTENUATION == ATTENUATION_FILL
FLAT VARYING float lone;   // see dwelt_opacity
#endif
#endif
