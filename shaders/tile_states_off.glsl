// Twin of tile_states.glsl for a processor, which marks tiles that are open.
#define CLOSED 2u

void begin_state() {}

void set_state(uint tile, bool more) {
    if (more) open[tile] = 1u;
}
