"""From samples to colour, extinction and shading."""
