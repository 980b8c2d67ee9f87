// Stages splats of a tile's list in shared memory, from where all pixels of the tile read them.
#include "wait_for_all.glsl"
#define BATCH 64u  // splats at a time: one an invocation
layout(std430, binding = 6) readonly buffer Listed { uint listed[]; };

// what read_texels returns, and the terms of bent splats
shared vec4 staged_heads[BATCH], staged_shapes[BATCH], staged_matters[BATCH];
shared vec4 staged_bends[BENT ? BATCH : 1u];
shared vec4 staged_cubics[BENT && CUBIC == 0 ? BATCH : 1u], staged_mixeds[BENT && CUBIC == 0 ? BATCH : 1u];
// invocations whose pixels need no more splats
shared uint finished;

// Stages entry `at` of the lists.
void stage_splat(uint slot, uint at) {
    uint n = listed[at];
    vec4 head, shape, matter;
    read_texels(n, head, shape, matter);
    staged_heads[slot] = head;
    staged_shapes[slot] = shape;
    staged_matters[slot] = matter;
    if (BENT) {
        ivec2 texel = texel_of(n);
        staged_bends[slot] = uintBitsToFloat(texelFetch(bends, texel, 0));
        if (CUBIC == 0) {
            staged_cubics[slot] = uintBitsToFloat(texelFetch(cubics, texel, 0));
            staged_mixeds[slot] = uintBitsToFloat(texelFetch(mixeds, texel, 0));
        }
    }
}

Joined staged_splat(uint slot) {
    Joined it = joined(staged_heads[slot], staged_shapes[slot], staged_matters[slot]);
    if (BENT) {
        it.bend = staged_bends[slot];
        if (CUBIC == 0) {
            it.cubic = staged_cubics[slot];
            it.mixed = staged_mixeds[slot];
        }
    }
    return it;
}
