"""A transfer function of one's own: by points, by keywords with colours at values, and from a preset."""

import splatgl as sg

volume = sg.scenes.ball(16)  # or sg.load("head.nii.gz")

shell = sg.Transfer(points=[(0.1, 0.0), (0.3, 0.3), (0.5, 0.0), (0.9, 0.5)], colormap="viridis", window=(0, 1))
sg.render(volume, shell, size=320).save("out-points.png")

colors = [(0.2, "navy"), (0.6, "#c04030"), (1.0, (1.0, 0.9, 0.6))]
sg.render(volume, points=[(0.2, 0.0), (0.9, 0.4)], colors=colors, size=320).save("out-colors.png")

sg.render(volume, sg.preset("surface", volume), size=320).save("out-preset.png")
