"""The plugin of napari: files as layers, and pictures of the viewer's layers. napari alone imports it."""
