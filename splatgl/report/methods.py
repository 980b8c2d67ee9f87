"""Registry of methods that trade accuracy for time.

An axis is one varied quantity; its methods are the values. `register` adds an axis to all reports.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from splatgl.errors import expected
from splatgl.splat.kernels import has_negative
from splatgl.splat.settings import Settings

# references of errors, with descriptions
TRUTHS = {
    "reference": "the float64 reference of the same splats, which mixes what the picture mixes: the error of drawing",
    "sampled": "exact splats at many samples a pixel: drawing and antialiasing",
    "integral": "the ray integral of the same splats, at as many samples: splatting too",
    "field": "the field itself, classified after reconstruction and finely marched: all of it, classification too",
}
DRAWING, ALL = ("reference",), tuple(TRUTHS)
FILTERING = ("sampled", "integral", "field")


@dataclass(frozen=True)
class Method:
    """A rendering method. name: in tables and for --only; label: in a diagram.

    changes: of Settings, relative to the exact splats of version 0.1, or, if from_scene, to the scene's settings, or,
    if paper, to the settings of 1998. z_s_share: z_s as a fraction of the way from the nearest to the farthest splat.
    row: of `reference.render`, which draws it in float64, untimed; "": OpenGL draws it.
    threshold: of the extractor, if above the scene's. coarse: number of downsamplings by two. quick: whether --quick
    includes it.
    """

    name: str
    changes: Mapping[str, Any] = field(default_factory=dict)
    label: str = ""
    from_scene: bool = False
    paper: bool = False
    z_s_share: float | None = None
    row: str = ""
    threshold: float = 0.0
    coarse: int = 0
    quick: bool = True

    def settings(self, base: Settings, depths: tuple[float, float]) -> Settings:
        """Settings of the method; depths: of the nearest and the farthest splat, world units."""
        chosen = base if self.from_scene else Settings.like("0.1", **base.given)
        if self.paper:
            shared = {name: getattr(base, name) for name in ("blend", "kernel", "shading", "background", "tolerance")}
            chosen = Settings.paper(**shared)
        if self.z_s_share is not None:
            near, far = max(depths[0], 0.0), depths[1]
            chosen = chosen.replace(z_s=near + self.z_s_share * (far - near))
        return chosen.replace(**self.changes)

    @property
    def words(self) -> str:
        """The name for newcomers."""
        if self.coarse:
            return f"every {2**self.coarse}{'nd' if self.coarse == 1 else 'th'} voxel, as a window while it moves"
        plain = {"antialias": "supersample"}.items() <= self.changes.items() and len(self.changes) == 2
        return f"single splats, {self.name} samples a pixel" if plain else WORDS.get(self.name, self.name)


Methods = tuple[Method, ...]


@dataclass(frozen=True)
class MethodAxis:
    """Methods of one varied quantity. truths: of its diagrams; connected: whether a line joins the methods.

    fronts: truths for whose front it competes, since other methods draw the same image; None: all `truths`. apart:
    whether it has no other truths, since it does not draw the image of the splats.
    """

    name: str
    about: str
    methods: Methods
    truths: tuple[str, ...] = DRAWING
    connected: bool = True
    fronts: tuple[str, ...] | None = None
    apart: bool = False

    def competes(self, truth: str) -> bool:
        """Whether its methods are ranked by their errors against that truth."""
        return truth in (self.truths if self.fronts is None else self.fronts)

    @property
    def measured(self) -> tuple[str, ...]:
        """Truths for the errors of its methods."""
        return self.truths if self.apart else ALL


AXES: dict[str, MethodAxis] = {}
# names for newcomers of methods that others are named after
WORDS = {
    "default": "what splatgl render draws",
    "exact": "single splats",
    "sheets 3": "sheets, coloured before reconstruction",
    "paper 1998": "the settings of 1998",
    "no antialiasing": "single splats without antialiasing",
    "gaussian": "Gaussian splats",
    "post b-spline": "sheets of a b-spline",
    "threshold 0.1": "single splats, none below an opacity of 0.1",
}


def register(axis: MethodAxis) -> MethodAxis:
    """Adds an axis to all reports. Raises InputError for a name in use."""
    taken = {axis.name for axis in AXES.values()} | set(methods())
    for name in (axis.name, *(method.name for method in axis.methods)):
        if name in taken:
            raise expected("method", "an unused name", repr(name))
    AXES[axis.name] = axis
    return axis


def methods() -> dict[str, Method]:
    """All methods by name, in the order of registration."""
    return {method.name: method for axis in AXES.values() for method in axis.methods}


def axis_of(name: str) -> MethodAxis:
    """The axis of a method."""
    return next(axis for axis in AXES.values() if any(method.name == name for method in axis.methods))


def _variants(name: str, key: str, values: tuple[Any, ...], quick: tuple[Any, ...] = (), **others: Any) -> Methods:
    """A method per value of a setting. quick: values that --quick includes, all if empty."""
    variants = []
    for value in values:
        text = f"{value:g}" if isinstance(value, float) else str(value)
        is_quick = not quick or value in quick
        variants.append(Method(f"{name} {text}", {**others, key: value}, text, quick=is_quick))
    return tuple(variants)


def _supersampled(name: str, counts: tuple[int, ...], **others: Any) -> Methods:
    """A method per number of samples along an axis of a pixel."""
    variants = []
    for k in counts:
        kind = {"antialias": "supersample", "samples": k} if k > 1 else {"antialias": "off"}
        label = f"{k}×{k}" if k > 1 else name
        variants.append(Method(f"{name} {label}" if k > 1 else name, {**others, **kind}, label, quick=k < 4))
    return tuple(variants)


def _post_axis(kernel: str) -> MethodAxis:
    """The axis of values that a kernel reconstructs."""
    return MethodAxis(
        f"post {kernel}",
        "classified after reconstruction, in sheets; at one and at k×k samples a pixel",
        _supersampled(f"post {kernel}", SAMPLES, classification="post", kernel=kernel),
        ("field",),
        apart=True,
    )


def _kernel_axis(name: str, kernel: str) -> MethodAxis:
    """The axis of single splats of a kernel."""
    return MethodAxis(
        name,
        "another kernel, against its own truths: not on their fronts, since it is another picture",
        (Method(kernel, {"kernel": kernel}, kernel),),
        ("reference", "field"),
        connected=False,
        fronts=("field",),
    )


def add_kernel(kernel: str) -> None:
    """Adds the axes of a kernel to the reports of this process, unless they are there. Raises InputError for one that
    is negative somewhere, which draws no composited picture.
    """
    if has_negative(kernel):
        raise expected("--kernel", "a kernel that is nowhere negative, as pictures of reports are composited", kernel)
    for axis in (_kernel_axis(f"kernel {kernel}", kernel), _post_axis(kernel)):
        if not {method.name for method in axis.methods} & set(methods()):
            register(axis)


DEFAULT, EXACT, PAPER = "default", "exact", "paper 1998"
# without its 8 bits of pixels, and of the table too: the form's own error
PAPER_TABLE, PAPER_FLOAT = "paper, 8-bit table", "paper, 32 bits"
# of Gaussians whose footprint weakens opacity
EWA, BESIDE_EWA, GAUSSIANS = "ewa splatting", "exact beside ewa", {"kernel": "gaussian", "attenuation": "opacity"}
SAMPLES, SIZES, QUICK_SIZES = (1, 2, 4), (32, 64, 128, 256, 512), (32, 128, 512)
for _axis in (
    MethodAxis(
        "default",
        "what settings on auto draw: sheets, classified after reconstruction where the scene allows it, k×k samples",
        (Method(DEFAULT, from_scene=True),),
        FILTERING,
        connected=False,
        apart=True,
    ),
    MethodAxis(
        "settings",
        "the practical settings of 1998, with and without their 8 bits, and exact splats",
        (
            Method(EXACT),
            Method(PAPER, paper=True, label="paper 1998"),
            Method(PAPER_TABLE, {"target": "rgba32f"}, "paper, 8-bit table", paper=True),
            Method(PAPER_FLOAT, {"table_bits": 32, "target": "rgba32f"}, "paper, 32 bits", paper=True),
        ),
        ALL,
        connected=False,
    ),
    MethodAxis(
        "form",
        "the footprint's form: one plane or direction for all, or the ray's own",
        tuple(Method(name, {"align": name}, name) for name in ("grid", "ray")),
        connected=False,
    ),
    MethodAxis(
        "hybrid",
        "ray-perpendicular up to z_s, grid-aligned beyond",
        tuple(
            Method(f"z_s {share:.0%}", {"align": "hybrid"}, f"{share:.0%}", z_s_share=share, quick=share == 0.5)
            for share in (0.25, 0.5, 0.75)
        ),
    ),
    MethodAxis(
        "hybrid by tolerance",
        "z_s taken from --tolerance",
        _variants("hybrid", "tolerance", (1e-1, 1e-2, 1e-3), (1e-2,), align="hybrid"),
    ),
    MethodAxis(
        "table",
        "texels along each side of a footprint texture, exact",
        _variants("table", "table_size", SIZES, QUICK_SIZES, footprint="table", align="exact"),
    ),
    MethodAxis(
        "table bits",
        "bits a texel of 256×256, exact",
        _variants("bits", "table_bits", (8, 16), footprint="table", align="exact"),
    ),
    MethodAxis(
        "radial",
        "entries of a table over the squared distance, exact",
        _variants("radial", "table_size", SIZES, QUICK_SIZES, align="exact"),
    ),
    _kernel_axis("kernel", "gaussian"),
    MethodAxis(
        "ewa",
        "EWA splatting, in float64 and untimed, beside form b′ of the same Gaussians; both weaken opacity",
        (Method(EWA, GAUSSIANS, row="ewa"), Method(BESIDE_EWA, GAUSSIANS)),
        ("reference", "field"),
        connected=False,
        fronts=(),
    ),
    MethodAxis(
        "attenuation",
        "what weakens beyond z_k",
        _variants("attenuation", "attenuation", ("opacity", "optical-depth")),
        FILTERING,
        connected=False,
    ),
    MethodAxis(
        "antialiasing off",
        "a sample in the middle of each pixel",
        (Method("no antialiasing", {"antialias": "off"}, "off"),),
        FILTERING,
        connected=False,
    ),
    MethodAxis(
        "supersampling",
        "k×k samples a pixel, instead of antialiased splats",
        tuple(
            Method(f"{k}×{k}", {"antialias": "supersample", "samples": k}, f"{k}×{k}", quick=k in (2, 4, 8))
            for k in (2, 3, 4, 6, 8)
        ),
        FILTERING,
    ),
    MethodAxis(
        "target",
        "the frame buffer's numbers; 8 bits mix display values",
        _variants("target", "target", ("rgba16f", "rgba8")),
        connected=False,
    ),
    MethodAxis(
        "technique", "quads instead of tiles", (Method("quads", {"technique": "quads"}, "quads"),), connected=False
    ),
    MethodAxis(
        "occlusion",
        "no tile ends before its list",
        (Method("no occlusion", {"occlusion": "off"}, "no occlusion"),),
        connected=False,
    ),
    MethodAxis("tolerance", "what --tolerance asks for", _variants("tolerance", "tolerance", (1e-1, 1e-2, 1e-3, 1e-4))),
    MethodAxis(
        "threshold",
        "voxels below that opacity left out",
        tuple(Method(f"threshold {t:g}", {}, f"{t:g}", threshold=t) for t in (0.01, 0.03, 0.1)),
        ALL,
    ),
    MethodAxis(
        "preview",
        "voxels joined 2×2×2, and again: what a window draws while it moves",
        tuple(Method(f"preview 1/{2**n}", {}, f"1/{2**n}", coarse=n) for n in (1, 2)),
        ALL,
    ),
    MethodAxis(
        "sheets",
        "splats add up within as many sheets, which composite; classified before",
        tuple(Method(f"sheets {n}", {"compositing": "sheets", "sheets": n}, str(n), quick=n == 3) for n in (2, 3, 4)),
        ("integral", "field"),
        apart=True,
    ),
    _post_axis("b-spline"),
    _post_axis("crawfis-max"),
):
    register(_axis)
