"""Plugins and bridges of other programs: napari, VTK and PyVista."""
