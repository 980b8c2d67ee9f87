// The field on the rays of a grid of pixels, at the first sheets from the eye: sheet by sheet, one block of rows below
// the other. Twin of near_sums in splatgl/truth/sheets.py.
// switch SIDE 4
#define VARYING
#define FLAT
#include "footprint_eval.glsl"
#constant ABSENT  // value of a voxel that holds none

uniform sampler3D near_voxels;   // of each voxel around the eye gradient and value
uniform sampler2D kernel_table;  // the kernel at a squared distance up to radius², over F(0), and the step to the next
uniform vec3 near_low;           // the first of them from the eye, index axes
uniform float thickness;         // of a sheet, index units
uniform int near_step;           // pixels, or samples, between two rays
uniform int near_rows;           // of a block

// gradient and value by mass, and mass
layout(location = 0) out vec4 sums;
layout(location = 1) out float mass;

void main() {
    ivec2 at = ivec2(gl_FragCoord.xy);
    int sheet = at.y / near_rows;
    vec2 pixel = vec2(at.x, at.y - sheet * near_rows) * float(near_step) + 0.5;
    vec3 place = normalize(index_from_eye() * ray_at(pixel)) * (thickness * float(sheet)) - near_low;
    ivec3 first = ivec3(floor(place)) - (SIDE / 2 - 1);
    float last = float(textureSize(kernel_table, 0).x - 1);
    sums = vec4(0.0);
    mass = 0.0;
    for (int z = 0; z < SIDE; z++)
        for (int y = 0; y < SIDE; y++)
            for (int x = 0; x < SIDE; x++) {
                ivec3 cell = first + ivec3(x, y, z);
                vec4 voxel = texelFetch(near_voxels, cell, 0);
                vec3 apart = place - vec3(cell);
                float entry = min(dot(apart, apart) / (style.radius * style.radius), 1.0) * last;
                vec2 line = texelFetch(kernel_table, ivec2(int(entry), 0), 0).rg;
                float weight = voxel.a < ABSENT ? line.x + line.y * (entry - floor(entry)) : 0.0;
                if (weight > 0.0) sums += voxel * weight;
                mass += weight;
            }
    sums *= thickness;
    mass *= thickness;
}
