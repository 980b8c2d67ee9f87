// Counts the splats of each run that touch each tile, or lists them by tile in drawing order. Each invocation processes
// one run of splats; within a tile's list, runs follow each other.
// switch COUNTING 0  only counts
// switch LANES 8     invocations of a group
// version 430
layout(local_size_x = LANES) in;
#define VARYING
#define FLAT
#include "tiles.glsl"

// per run and tile: the count, or the next position, which lies beyond all entries where light passes the tile no more
layout(std430, binding = 0) buffer Cursors { uint cursors[]; };
// per run: splats done; whether the next has begun, and the tile that it has come to
layout(std430, binding = 1) buffer Done { uvec4 done[]; };
layout(std430, binding = 6) writeonly buffer Listed { uint listed[]; };
layout(rgba32ui, binding = 0) readonly uniform uimage2D bounds;  // read in half the instructions of a texel

uniform uint count;
uniform uint length_;  // of a run
uniform uint unread;   // an entry of the list beyond all tiles' entries
uniform uint budget;   // loop iterations per dispatch; the next dispatch continues
uniform float stride;  // pixels of the view from one sample to the next

// A splat, the tile it has come to, and the tiles it touches: rows, and those along the current one.
struct Placed {
    vec2 center;
    Extent extent;
    ivec2 tile;
    ivec2 rows;
    ivec2 span;
};

Placed placed(uint n) {
    vec4 it = uintBitsToFloat(imageLoad(bounds, texel_of(n)));
    Extent extent = unpacked_extent(it.zw);
    it.xy /= stride;
    extent.height /= stride;
    extent.width /= stride;
    ivec2 rows = rows_of(it.y, extent.height);
    return Placed(it.xy, extent, ivec2(0, rows.x), rows, ivec2(0));
}

// Sets the tiles along the current row, and goes to the first.
void begin_row(inout Placed it) {
    it.span = span_of(it.center, it.extent, it.tile.y);
    it.tile.x = it.span.x;
}

void main() {
    uint run = gl_GlobalInvocationID.x;
    uint nobody = uint(tiles.x * tiles.y);
    uint column = run * (nobody + 1u);
    uint n = run * length_ + done[run].x;
    uint end = min((run + 1u) * length_, count);
    Placed it = placed(n);
    bool resumed = done[run].y == 1u;
    if (resumed) it.tile.y = int(done[run].w);
    begin_row(it);
    if (resumed) it.tile.x = int(done[run].z);
    // one loop over splats and their tiles: SIMD lanes do not wait for another lane's large splat
    for (uint turn = 0u; n < end && turn < budget; turn++) {
        bool touched = it.tile.x <= it.span.y && it.tile.y <= it.rows.y;
        // non-touching splats write to a dummy slot, which avoids divergence
        uint slot = column + (touched ? uint(it.tile.y * tiles.x + it.tile.x) : nobody);
        uint place = atomicAdd(cursors[slot], 1u);
        if (COUNTING == 0) listed[min(place, unread)] = n;
        it.tile.x++;
        // one evaluation of the next row, of this splat or of the next: masked code takes its time in any case
        if (it.tile.x > it.span.y || it.tile.y > it.rows.y) {
            it.tile.y++;
            if (it.tile.y > it.rows.y) {
                n++;
                it = placed(n);
            }
            begin_row(it);
        }
    }
    done[run] = uvec4(n - run * length_, it.tile != ivec2(it.span.x, it.rows.x), it.tile);
}
