// States of tiles on a graphics card, from dispatch to dispatch: untouched, CONTINUED, or CLOSED.
#include "wait_for_all.glsl"
#constant CONTINUED
#constant CLOSED
// invocations whose pixels need more splats
shared uint unfinished;

// Begins a tile; all invocations of its group call this, before any wait.
void begin_state() {
    if (gl_LocalInvocationIndex == 0u) unfinished = 0u;
    wait_for_all();
}

// Sets a tile's state; all invocations of its group call this. more: whether this one's pixel needs more splats.
void set_state(uint tile, bool more) {
    if (more) atomicAdd(unfinished, 1u);
    wait_for_all();
    if (gl_LocalInvocationIndex == 0u) open[tile] = unfinished > 0u ? CONTINUED : CLOSED;
}
