"""Plotters of PyVista and renderers of VTK: their scenes, and plotters of scenes. VTK is imported where one is used."""
