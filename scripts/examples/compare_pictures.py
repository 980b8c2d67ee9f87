"""Compares two pictures: metrics, and the verdict that CI uses."""

import splatgl as sg

volume = sg.scenes.ball(24)
exact = sg.render(volume, size=256)
paper = sg.render(volume, paper=True, background="white", size=256)
paper.save("out.png")

print(sg.compare(paper, exact))
verdict = sg.judge("out.png", exact, noise="driver")
print(verdict)
assert not verdict.same and sg.judge("out.png", paper).same
