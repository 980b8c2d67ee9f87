// Lights the matter between two places of a pixel's ray: by its gradient, by the face of a mask, and by the face that a
// clip plane leaves.
#include "light.glsl"
// of a pixel's ray: normal of the plane at which it begins, world axes, or 0; and the end of the face there
vec4 face[ROWS];
// its cell of ambient occlusion and shadows at sheet 0, and cells per sheet
vec3 first_cell[ROWS], cell_step[ROWS];

// The cell of a place of a pixel's ray, in sheets.
vec3 cell_of(int row, float sheet) {
    if (CARD == 0) return first_cell[row] + cell_step[row] * sheet;
    return cell_at(layer_first[row] + box_low + 0.5 + layer_step[row] * sheet);
}

// Direction to the light, world axes, or 0: along the ray.
vec3 light_direction() {
    vec3 shines = vec3(0.0);
    if (LIGHT == 1)
        for (int axis = 0; axis < 3; axis++) shines[axis] = dot(style.light.xyz, frame.eye_from_world[axis].xyz);
    return shines;
}

// The factor of colors and the highlight of a surface at a place of a ray, in sheets. normal: world axes, of any length.
vec2 lit_surface(int row, vec3 normal, float sheet) {
    return surface_light(normal, toward[row], light_direction(), reached(cell_of(row, sheet), normal, toward[row]));
}

// The factor of colors and the highlight of matter. gradient: of the matter, world axes; 0 is unshaded.
vec2 light_of(int row, vec3 gradient, float begin, float end) {
    float at = 0.5 * (begin + end);
    vec3 cell = cell_of(row, at), shines = light_direction();
    if (SHADING == 0) gradient = vec3(0.0);
    vec2 light = surface_light(gradient, toward[row], shines, reached(cell, gradient, toward[row]));
    if (SHADING == 0) return light;
    vec4 mask = mask_face(row, at, gradient);
    if (mask.a > 0.0) {
        vec2 share = reached(cell, mask.xyz, toward[row]);
        light = mix(light, surface_light(mask.xyz, toward[row], shines, share), mask.a);
    }
    float faced = clamp((face[row].w - begin) / max(end - begin, 1e-20), 0.0, 1.0);
    if (CLIPPED == 1 && face[row].xyz != vec3(0.0)) {
        vec2 share = reached(cell, face[row].xyz, toward[row]);
        light = mix(light, surface_light(face[row].xyz, toward[row], shines, share), faced);
    }
    return light;
}
