// What a quad's corners hand to its fragments: few and packed, since a software rasteriser sets up each of
// them for each triangle. VARYING is defined as `out` in the vertex shader and `in` in the fragment shader.
// switch SPRITE 0

#if SPRITE
flat VARYING vec4 to_local;  // see Sprite
flat VARYING vec2 pixel;     // the centre
#else
VARYING vec2 at;           // place in the footprint: [−1, 1]², or for exact quads in voxels
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
