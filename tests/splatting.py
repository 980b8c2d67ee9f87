"""Settings of the tests of splats: what version 0.1 drew by default."""

from __future__ import annotations

import splatgl as sg

# voxels classified before reconstruction, splats one by one, stretched beyond z_k
SPLATS = sg.Settings.like("0.1")
