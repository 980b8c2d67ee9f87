"""What one picture needs: layers, order, techniques, bounds."""
