// Draws the sheets around the eye, the first of which is behind it, on the rays of a grid of pixels: a block of rows a
// sheet. Twin of near_sums in splatgl/reference/sheets.py.
// switch SIDE 4  voxels around the eye along an axis
#define VARYING
#define FLAT
#include "footprint_eval.glsl"
#include "sheets.glsl"
#constant ABSENT  // value of a voxel that holds none

uniform sampler3D near_voxels;   // of each voxel around the eye gradient and value
uniform vec3 near_low;           // the first of them from the eye, index axes
uniform int near_step;           // pixels, or samples, between two rays
uniform int near_rows;           // of a block

// gradient and value by mass, and mass
layout(location = 0) out vec4 sums;
layout(location = 1) out float mass;

void main() {
    ivec2 at = ivec2(gl_FragCoord.xy);
    int sheet = at.y / near_rows;
    vec2 pixel = vec2(at.x, at.y - sheet * near_rows) * float(near_step) + 0.5;
    vec3 along = normalize(index_from_eye() * ray_at(pixel));
    vec3 place = along * (thickness * float(sheet - 1)) - near_low;
    ivec3 first = ivec3(floor(place)) - (SIDE / 2 - 1);
    sums = vec4(0.0);
    mass = 0.0;
    for (int z = 0; z < SIDE; z++)
        for (int y = 0; y < SIDE; y++)
            for (int x = 0; x < SIDE; x++) {
                ivec3 cell = first + ivec3(x, y, z);
                vec4 voxel = texelFetch(near_voxels, cell, 0);
                vec3 apart = vec3(cell) - place;
                float ahead = dot(apart, along);
                float weight = voxel.a < ABSENT ? radial(dot(apart, apart) - ahead * ahead) : 0.0;
                weight *= sheet_share(ahead / thickness);
                if (weight > 0.0) sums += voxel * weight;
                mass += weight;
            }
}
