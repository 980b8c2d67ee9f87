// Keeps the open sheets of tiles whose lists continue in another dispatch.
#define KEPT 8  // vectors of a pixel; behind them is one of the column
layout(std430, binding = 5) buffer Rings { vec4 rings[]; };
#define RING_TILE (CARD == 1 ? tile - first_tile : tile)
#define RING(number, row) \
    rings[((RING_TILE * uint(KEPT + 1) + uint(number)) * TILE_ROWS + uint(row)) * COLUMNS + gl_LocalInvocationID.x]

// one value takes no gradients: without their sums, programs are shorter
#define RING_SUMS(number, row) (ONE_VALUE ? vec4(vec3(0.0), RING(number, row).a) : RING(number, row))

// Of a row of the tile, whose values are those of row 0.
void read_pixel(uint tile, int row) {
    sum0[0] = RING_SUMS(0, row);
    sum1[0] = RING_SUMS(1, row);
    if (SHEETS > 2) sum2[0] = RING_SUMS(2, row);
    if (SHEETS > 3) sum3[0] = RING_SUMS(3, row);
    masses[0] = RING(4, row);
    middle[0] = RING_SUMS(5, row);
    before[0] = RING_SUMS(6, row);
    vec4 rest = RING(7, row);
    held[0].yz = rest.xy;
    spread[0].yz = rest.zw;
}

void write_pixel(uint tile, int row) {
    RING(0, row) = sum0[0];
    RING(1, row) = sum1[0];
    if (SHEETS > 2) RING(2, row) = sum2[0];
    if (SHEETS > 3) RING(3, row) = sum3[0];
    RING(4, row) = masses[0];
    RING(5, row) = middle[0];
    RING(6, row) = before[0];
    RING(7, row) = vec4(held[0].yz, spread[0].yz);
}

// begun: whether the column was written before.
void read_column(uint tile, out int current, out int holding, out bool begun) {
    vec4 column = RING(KEPT, 0);
    current = int(column.x);
    holding = int(column.y);
    begun = column.z > 0.0;
}

void write_column(uint tile, int current, int holding) {
    RING(KEPT, 0) = vec4(current, holding, 1.0, 0.0);
}
