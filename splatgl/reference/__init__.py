"""The reference: exact pictures in float64. `sg.reference.render` draws them."""

from splatgl.reference.renderer import render as render
