"""Surfaces, balls and tubes in a volume; sg.load_mesh reads PLY, STL, OBJ, VTP, … from files."""

import numpy as np

import splatgl as sg

volume = sg.scenes.ball(20)
t = np.linspace(0, 4 * np.pi, 80)
path = np.stack([9 * np.cos(t), 9 * np.sin(t), np.linspace(-14, 14, 80)], axis=1) + volume.center
tube = sg.Mesh.of_lines([path], radius=0.5, color="#4682b4")
ends = sg.Mesh.of_points(path[[0, -1]], radius=1.5, color="#d04020")

sg.render(volume, points=[(0, 0), (1, 0.03)], meshes=[tube, ends], size=320, background="white").save("out.png")
