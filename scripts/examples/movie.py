"""A movie of a turning volume; .mp4 and .webm need the extra video."""

import splatgl as sg

volume = sg.scenes.ball(16)  # or the name of a file, or a list of time points
(movie,) = sg.animate(volume, "out.gif", frames=8, turntable=360, fps=8, size=200)
print(f"{movie}: {movie.stat().st_size:,} bytes")
