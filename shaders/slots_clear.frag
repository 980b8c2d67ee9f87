// Empties slots of layer_slots.glsl.
out uvec4 piece;

void main() {
    piece = uvec4(0u);
}
