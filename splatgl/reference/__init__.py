"""The reference: the right picture in float64. `sg.reference.render` draws it."""

from splatgl.reference.renderer import render as render
