// Counts how many splats of each run touch each tile, or lists them by tile, in drawing order: a run of splats for each
// invocation, and each run goes on where those before it end.
// switch COUNTING 0
layout(local_size_x = 8) in;
#define VARYING
#define FLAT
#include "tiles.glsl"

layout(std430, binding = 0) buffer Cursors { uint cursors[]; };  // run after run: how many, or where the next one goes
#if !COUNTING
layout(r32ui, binding = 0) writeonly uniform uimage2D list;
#endif
uniform sampler2D heads;
uniform sampler2D shapes;

uniform uint count;
uniform uint length_;  // of a run
uniform uint done;     // of each run, and to do now
uniform uint step_;

void main() {
    uint run = gl_GlobalInvocationID.x;
    uint column = run * uint(tiles.x * tiles.y);
    uint begin = run * length_ + done;
    uint end = min(min(begin + step_, (run + 1u) * length_), count);
    for (uint n = begin; n < end; n++) {
        vec4 head = texelFetch(heads, texel_of(n), 0);
        vec4 shape = texelFetch(shapes, texel_of(n), 0);
#if BENT
        shape.xyz = form_of(shape);
#endif
        float radius = circle_around(shape.xyz, head.w);
        ivec4 around = tiles_around(head.xy, head.w);
        if (around.x > around.z || around.y > around.w) continue;
        // one loop over both axes: where invocations run abreast, each waits for the longest
        ivec2 tile = around.xy;
        do {
            if (touches(tile, head.xy, radius)) {
                uint slot = column + uint(tile.y * tiles.x + tile.x);
                uint place = cursors[slot];
#if !COUNTING
                imageStore(list, listed_at(place), uvec4(n));
#endif
                cursors[slot] = place + 1u;
            }
            tile = tile.x < around.z ? tile + ivec2(1, 0) : ivec2(around.x, tile.y + 1);
        } while (tile.y <= around.w);
    }
}
