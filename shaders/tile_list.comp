// Counts the splats of each run that touch each tile, or lists them by tile in drawing order. Each invocation processes
// one run of splats; within a tile's list, runs follow each other.
// switch COUNTING 0
#constant LANES  // invocations of a group
layout(local_size_x = LANES) in;
#define VARYING
#define FLAT
#constant NOWHERE  // the cursor of a tile that light passes no more
#include "tiles.glsl"

layout(std430, binding = 0) buffer Cursors { uint cursors[]; };  // per run and tile: the count, or the next position
layout(std430, binding = 1) buffer Done { uint done[]; };        // splats done per run
layout(r32ui, binding = 0) writeonly uniform uimage2D list;
uniform usampler2D bounds;

uniform uint count;
uniform uint length_;  // of a run
uniform uint unread;   // an entry of the list beyond all tiles' entries
uniform uint budget;   // loop iterations per dispatch; the next dispatch continues

void main() {
    uint run = gl_GlobalInvocationID.x;
    uint nobody = uint(tiles.x * tiles.y);
    uint column = run * (nobody + 1u);
    uint n = run * length_ + done[run];
    uint end = min((run + 1u) * length_, count);
    vec4 it = uintBitsToFloat(texelFetch(bounds, texel_of(n), 0));
    ivec4 around = tiles_around(it.xy, it.z);
    ivec2 tile = around.xy;
    // one loop over splats and their tiles: SIMD lanes do not wait for another lane's large splat
    for (uint round = 0u; n < end && (round < budget || tile != around.xy); round++) {
        bool within = all(lessThanEqual(tile, around.zw));
        bool touched = within && touches(tile, it.xy, it.w);
        // non-touching splats write to a dummy slot, which avoids divergence
        uint slot = column + (touched ? uint(tile.y * tiles.x + tile.x) : nobody);
        uint place = cursors[slot];
        if (COUNTING == 0) {
            imageStore(list, listed_at(min(place, unread)), uvec4(n));
            touched = touched && place != NOWHERE;
        }
        cursors[slot] = place + uint(touched);
        tile = tile.x < around.z ? tile + ivec2(1, 0) : ivec2(around.x, tile.y + 1);
        if (!within || tile.y > around.w) {
            n++;
            it = uintBitsToFloat(texelFetch(bounds, texel_of(n), 0));
            around = tiles_around(it.xy, it.z);
            tile = around.xy;
        }
    }
    done[run] = n - run * length_;
}
