// What a quad's corners hand to its fragments: few and packed, since a software rasteriser sets up each of
// them for each triangle. VARYING is defined as `out` in the vertex shader and `in` in the fragment shader.
// switch SPRITE 0
#include "motion.glsl"

#if SPRITE
flat VARYING vec4 to_local;  // see Sprite
flat VARYING vec2 pixel;     // the centre
#else
VARYING vec2 at;           // place in the footprint: [−1, 1]², or for exact quads in voxels; for streaks, see passing
#endif
flat VARYING vec4 splat;   // linear RGB, shaded; optical depth, or for mip the opacity, at the centre
#if ATTENUATION == ATTENUATION_OPACITY
flat VARYING float coverage;  // 1/m² [M98 Eq. 6]
#endif
#if ALIGN == ALIGN_EXACT
#if ANTIALIAS || !SPRITE
flat VARYING vec4 bend;    // see ExactQuad
#endif
#if ANTIALIAS && !CUBIC
flat VARYING vec4 cubic;
flat VARYING vec4 mixed;
#endif
#if HALF_LINE
flat VARYING vec4 center;  // the voxel relative to the eye, index axes (eye axes for cubes); w is 1 if around the eye
#endif
#endif
#if MOTION != MOTION_OFF
flat VARYING vec3 heart;   // the middle of a streak's path, eye axes
flat VARYING vec2 move;    // Streak's step; 0 for what stands still
flat VARYING vec2 shrink;  // see Inner
#if !CUBIC
flat VARYING vec3 inner_x;
flat VARYING vec3 inner_y;
#endif
#if ATTENUATION == ATTENUATION_FILL
flat VARYING float lone;   // see dwelt_opacity
#endif
#endif
