"""Table 1's rows against form b′: the largest error of one splat by its place, in levels."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from paper.figures.footprint_errors import ALL, Space
from paper.figures.paper_setup import PAPER
from paper.tables import Table

from splatgl.report.diagram import BLACK, BLUE, GRAY, GREEN, ORANGE, RED, sheet

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CAPTION = (
    "Four approximations of Table 1 and form b′ against row 1, the correct stretch: the largest error of a splat over "
    "all rays, in 1/255 of its peak, by the place of its voxel in the paper's volume. Before z_k rows 2 and 3 and "
    "form b′ are row 1."
)
FORMS = {"row2": "row 2", "row3": "row 3", "row4": "row 4", "row5": "row 5", "bprime": "form b′"}
# (x, y) as fractions of the volume's half width, and depths behind z_k
PLACES = {"near the axis": (0.0, 1 / 16), "half-way": (0.0, 0.5), "edge": (0.0, 1.0), "corner": (1.0, 1.0)}
BEHIND = (-50.0, 1.0, 70.0, 200.0, PAPER.back - PAPER.z_k)


def forms_table() -> Table:
    """The errors by place and depth, levels."""
    where = [(name, behind) for name in PLACES for behind in BEHIND]
    voxel = np.array([(*(PAPER.edge * part for part in PLACES[name]), PAPER.z_k + behind) for name, behind in where])
    space = Space(PAPER.kernel, PAPER.z_k, voxel)
    levels = np.stack([space.levels(ALL[form]) for form in FORMS], axis=1).tolist()
    rows = tuple((name, f"{behind:+.0f}", *row) for (name, behind), row in zip(where, levels, strict=True))
    return Table(("place", "z_v − z_k", *FORMS.values()), rows)


# of the picture: depths behind z_k in each panel, and a colour of each form
STEPS, COLORS = 24, (BLUE, GREEN, ORANGE, RED, BLACK)


def forms_picture() -> Figure:
    """The errors over depth, a panel of each place; levels, on one logarithmic scale."""
    behind = np.linspace(BEHIND[0], BEHIND[-1], STEPS)
    figure = sheet(3.6)
    panels = figure.subplots(2, 2, sharex=True, sharey=True)
    for axes, (place, parts) in zip(panels.flat, PLACES.items(), strict=True):
        voxel = np.array([(*(PAPER.edge * part for part in parts), PAPER.z_k + depth) for depth in behind])
        space = Space(PAPER.kernel, PAPER.z_k, voxel)
        for n, (form, name) in enumerate(FORMS.items()):
            levels = np.where((error := space.levels(ALL[form])) > 0, error, np.nan)
            dashes = () if form == "bprime" else (6 - n, 1.5)
            axes.plot(behind, levels, color=COLORS[n], dashes=dashes, lw=1.2 if n < 4 else 1.6, label=name)
        axes.axvline(0.0, color=GRAY, lw=0.6, dashes=(4, 2))
        axes.set_title(place)
        axes.set(yscale="log", ylim=(1e-4, 200))
    figure.supxlabel("$z_v - z_k$", fontsize=8)
    figure.supylabel("largest error, 1/255 of the peak", fontsize=8)
    figure.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=5, handlelength=1.8)
    return figure
