"""The needs of one picture: layers, order, techniques, bounds."""
