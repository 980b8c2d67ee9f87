#!/usr/bin/env bash
# The core alone: a wheel, in an environment that holds the six core packages and nothing else, draws a picture.
set -euo pipefail
. "$(dirname "${BASH_SOURCE[0]}")/setup.sh"

ensure run
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

say "building a wheel and installing it with its core dependencies only"
alone=()
# a copy of what builds wheels takes longer than building them
if "$venv/bin/python" -c 'import hatchling' 2>/dev/null; then alone=(--no-build-isolation); fi
"$venv/bin/python" -m pip wheel --quiet --no-deps "${alone[@]}" --wheel-dir "$work" "$repo"
"$venv/bin/python" -m venv --without-pip "$work/venv"
core=$work/venv/bin/python
fill() { "$venv/bin/python" -m pip --python "$core" install --quiet --no-compile "$@"; }
fill -c "$repo/constraints.txt" "$work"/splatgl-*.whl || fill "$work"/splatgl-*.whl

# Outside the repository, so that only what the wheel brought can be found
cd "$work"
"$core" - <<'PYTHON'
import re
from importlib import util
from importlib.metadata import requires

needed = sorted(re.split(r"[^\w-]", line)[0].lower() for line in requires("splatgl") if "extra ==" not in line)
assert needed == ["glfw", "moderngl", "numpy", "pillow", "pyrr", "pytest"], f"core dependencies: {needed}"
extras = [name for name in ("nrrd", "nibabel", "tifffile", "zarr", "cmap", "matplotlib", "tqdm") if util.find_spec(name)]
assert not extras, f"not a core environment: {extras}"
PYTHON

"$core" -m splatgl render tunnel -o x.png
"$core" - <<'PYTHON'
import numpy as np
from PIL import Image

pixels = np.asarray(Image.open("x.png").convert("RGBA"), dtype=float)
assert pixels.size and np.ptp(pixels, axis=(0, 1)).max() > 32, f"x.png is blank: {pixels.shape}"
print(f"core alone: x.png {pixels.shape[1]}×{pixels.shape[0]}, drawn by the six core packages")
PYTHON
