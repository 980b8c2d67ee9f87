"""Plans of one picture: layers, order, techniques, error bounds."""
