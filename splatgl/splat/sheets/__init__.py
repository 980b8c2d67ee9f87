"""Sheets: slabs of equal distance from the eye, within which splats add up and between which they composite."""
