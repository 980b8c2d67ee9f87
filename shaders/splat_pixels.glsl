// Composites the splats of a tile on a graphics card: each invocation draws one pixel, from batches of splats that all
// share, until it is opaque.
#include "staged_splats.glsl"
#include "tile_states.glsl"

void composite_tile(uvec4 mine, uint lane) {
    uint tile = mine.x, at = mine.y, end = mine.z;
    if (open[tile] == CLOSED || at == end) return;
    ivec2 pixel = first_pixel(tile, lane);
    first = vec2(pixel) + 0.5;
    Ray ray = ray_of(first);
    vec4 light = CARRIED == 1 ? imageLoad(target, pixel) : vec4(0.0);
    coverage = table_quad(vec3(0.0)).coverage;
    bool inside = all(lessThan(pixel, imageSize(target)));
    bool ended = !inside || (IN_ORDER && light.a > opaque), counted = false;
    if (lane == 0u) finished = 0u;
    begin_state();
    while (at < end) {
        uint count = min(end - at, BATCH);
        if (lane < count) stage_splat(lane, at + lane);
        wait_for_all();
        for (uint i = 0u; i < count && !ended; i++) {
            Joined it = scaled(staged_splat(i));
            choose(it);
            light = join_splat(light, splat.rgb, blended(splat.a * share_at(it, ray, 0.0)));
            ended = IN_ORDER && light.a > opaque;
        }
        if (ended && !counted) atomicAdd(finished, 1u);
        counted = ended;
        wait_for_all();
        if (finished == uint(LANES)) break;
        at += count;
    }
    if (inside) imageStore(target, pixel, light);
    set_state(tile, !ended);
}
