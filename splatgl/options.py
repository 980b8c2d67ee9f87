"""Options: a field of a dataclass declares one for the command line, keywords, TOML files and the panel."""

from __future__ import annotations

import re
from argparse import ArgumentTypeError
from collections.abc import Callable, Iterable, Mapping
from dataclasses import MISSING, dataclass, field, fields, replace
from difflib import get_close_matches
from enum import StrEnum
from inspect import Parameter, Signature, cleandoc, isfunction, signature
from math import inf, isfinite
from numbers import Real
from textwrap import shorten
from typing import Any, ClassVar, Literal, TypeVar, get_args

from splatgl.errors import SIMILAR, InputError, expected


class HelpGroup(StrEnum):
    """Groups of options, in the order of `--help-all`."""

    VIEW = "view"
    PICTURE = "picture and light"
    TRANSFER = "transfer function"
    CLIPPING = "clipping and masks"
    LAYERS = "layers and meshes"
    READING = "reading files"
    OUTPUT = "output"
    ACCURACY = "accuracy"
    SPEED = "performance"
    WORKERS = "several processes or machines (extra scale)"
    OPENGL = "OpenGL"
    PAPER = "the paper's method, and experts"
    ANIMATION = "animation"
    EXPORT = "the file"
    COMPARISON = "comparison"
    LIMITS = "limits"


def _literal(*values: object) -> str:
    return f"Literal[{', '.join(f'{value!r}' for value in values)}]"


def is_number(value: object) -> bool:
    """Whether a value is a real number, and not a bool."""
    return isinstance(value, Real) and not isinstance(value, bool)


@dataclass(frozen=True)
class ValueKind:
    """Kind of value. this: its description in messages; written: of its text, unless that is metavar and `this`. check:
    returns the value that is stored, of a keyword or of TOML; read: the value of a command line's text. Both raise
    TypeError or ValueError for others. choices: its values, the default first. span: lowest and highest number. hint:
    type of a keyword's value, as Python that type checkers read.
    """

    this: str
    check: Callable[[Any], Any]
    read: Callable[[str], Any] = str
    metavar: str = "NAME"
    choices: Callable[[], tuple[str, ...]] | None = None
    span: tuple[float, float] = (-inf, inf)
    written: str = ""
    hint: str = ""

    def parse(self, text: str) -> Any:
        """An argparse type: the value of a text."""
        try:
            return self.read(text)
        except InputError as error:
            raise ArgumentTypeError(str(error)) from None
        except (ValueError, OverflowError):
            this = self.written or f"{self.metavar}, {self.expected}"
            raise ArgumentTypeError(f"expected {this}, got {text[:80]!r}") from None

    @property
    def expected(self) -> str:
        """Description of the value in messages."""
        return self.this or " or ".join(self.choices() if self.choices else ())

    @staticmethod
    def choice(names: Any, this: str = "") -> ValueKind:
        """One of some names: a Literal or iterable of them, or a function that lists those known at the time."""
        fixed = get_args(names) or (() if isfunction(names) else tuple(names))

        def known() -> tuple[str, ...]:
            return fixed or tuple(names())

        def check(value: Any) -> Any:
            if value not in known():
                raise ValueError
            return value

        return ValueKind(this, check, choices=known, hint=_literal(*fixed) if fixed else "str")

    @staticmethod
    def number(
        this: str = "one finite number", low: float = -inf, high: float = inf, above: bool = False, metavar: str = "N"
    ) -> ValueKind:
        """A finite number from `low`, or above it, to `high`."""

        def check(value: Any) -> float:
            if not (is_number(value) and isfinite(value) and low <= value <= high) or (above and value == low):
                raise ValueError
            return float(value)

        return ValueKind(this, check, float, metavar, span=(low, high), hint="float")

    @staticmethod
    def whole(low: int, high: float = inf, this: str = "", metavar: str = "N") -> ValueKind:
        """A whole number from `low` to `high`."""

        def check(value: Any) -> int:
            if not (is_number(value) and isfinite(value) and low <= value <= high and value == int(value)):
                raise ValueError
            return int(value)

        this = this or f"a whole number {f'from {low} to {high}' if high < inf else f'of at least {low}'}"
        return ValueKind(this, check, int, metavar, span=(low, high), hint="int")

    @staticmethod
    def one_of(*values: int) -> ValueKind:
        """One of some whole numbers."""
        names = tuple(map(str, values))

        def check(value: Any) -> int:
            if isinstance(value, bool) or value not in values:
                raise ValueError
            return int(value)

        this = f"{', '.join(names[:-1])} or {names[-1]}"
        return ValueKind(this, check, int, "|".join(names), hint=_literal(*values))

    @staticmethod
    def instance(this: str, *types: type, metavar: str = "NAME") -> ValueKind:
        """A value of some types; a bool is no number."""

        def check(value: Any) -> Any:
            if not isinstance(value, types) or (isinstance(value, bool) and bool not in types):
                raise ValueError
            return value

        return ValueKind(this, check, str, metavar, hint=" | ".join(kind.__name__ for kind in types))

    @staticmethod
    def numbers(count: int, metavar: str, this: str = "", integers: bool = False, positive: bool = False) -> ValueKind:
        """A tuple of so many finite numbers: a sequence of them, or text in which commas or × separate them."""
        kind: Any = int if integers else float

        def check(value: Any) -> tuple[Any, ...]:
            plain = tuple(value.tolist() if hasattr(value, "tolist") else value)
            fine = len(plain) == count and all(is_number(n) and isfinite(n) and n == kind(n) for n in plain)
            if not fine or (positive and min(plain) <= 0):
                raise ValueError
            return tuple(map(kind, plain))

        def read(text: str) -> tuple[Any, ...]:
            parts = text.replace("×", ",").replace("x", "," if integers else "x").split(",")
            if len(parts) != count:
                raise ValueError
            return tuple(map(kind, parts))

        this = this or f"{count} {'whole' if integers else 'finite'} numbers"
        return ValueKind(this, check, read, metavar, hint="Numbers")

    @staticmethod
    def interval() -> ValueKind:
        """Two numbers, of which the first is below the second."""
        pair = ValueKind.numbers(2, "LOW,HIGH", "finite low < high, as two numbers")

        def check(value: Any) -> tuple[float, float]:
            low, high = pair.check(value)
            if not low < high:
                raise ValueError
            return low, high

        return replace(pair, check=check)

    @staticmethod
    def picture_size() -> ValueKind:
        """Width and height in pixels: two whole numbers, or text WIDTHxHEIGHT or of one number for a square."""
        this = "a width and a height of at least one whole pixel, such as 800x600"
        pair = ValueKind.numbers(2, "W×H", this, integers=True, positive=True)

        def read(text: str) -> tuple[int, int]:
            sides = [int(part) for part in text.lower().replace("×", "x").split("x")]
            width, height = sides * 2 if len(sides) == 1 else sides
            return width, height

        def check(value: Any) -> tuple[int, int]:
            plain = isinstance(value, str | int) and not isinstance(value, bool)
            width, height = pair.check(read(str(value)) if plain else value)
            return width, height

        return replace(pair, check=check, read=read, hint="int | str | Numbers")

    @staticmethod
    def flag() -> ValueKind:
        """True or false; the flag of the command line takes no value."""
        return ValueKind.instance("true or false", bool, metavar="")


SIZE = ValueKind.picture_size()


@dataclass(frozen=True)
class Option:
    """An option. help: `--help` shows the first sentence. group: "" for options of files and records alone. level:
    `--help` shows basic options, `--help-all` all. label: name in the panel. flag: name on the command line, if not the
    field's. bare: value of the flag alone. repeat: whether the flag may be repeated.
    """

    kind: ValueKind
    help: str = ""
    group: str = ""
    level: Literal["basic", "more", "expert"] = "more"
    label: str = ""
    flag: str = ""
    metavar: str = ""
    bare: Any = None
    repeat: bool = False

    @property
    def choices(self) -> tuple[str, ...]:
        """Values to choose from, the default first; () if there are others."""
        return self.kind.choices() if self.kind.choices else ()

    @property
    def is_bare(self) -> bool:
        """Whether the flag takes no value."""
        return self.bare is not None and not self.kind.metavar

    @property
    def summary(self) -> str:
        """First sentence of the help."""
        return self.help.partition(". ")[0]


def option(default: Any, kind: ValueKind, help: str = "", **more: Any) -> Any:
    """A field of a dataclass that declares an option; more: further fields of Option."""
    return field(default=default, metadata={"option": Option(kind, help, **more)})


def declared(record: Any) -> dict[str, Option]:
    """Options of a dataclass by the names of their fields."""
    return {f.name: f.metadata["option"] for f in fields(record) if "option" in f.metadata}


def names_of(*records: Any) -> list[str]:
    """Names of the options of dataclasses that the command line and keywords have."""
    return [name for record in records for name, option in declared(record).items() if option.group]


Target = TypeVar("Target", bound=Any)
# most choices that a line of help lists, and its length
MOST_CHOICES, LONGEST_LINE = 8, 140


class Keyword(Parameter):
    """A parameter that is given by its name, with a line of help."""

    __slots__ = ("help",)

    def __init__(self, name: str, kind: Any = Parameter.KEYWORD_ONLY, *, help: str = "", **more: Any) -> None:
        super().__init__(name, kind, **more)
        self.help = help

    def replace(self, **changes: Any) -> Keyword:
        """The keyword with changes."""
        changed = super().replace(**changes)
        changed.help = self.help
        return changed


def keyword(name: str, hint: str, default: Any = None, help: str = "") -> Keyword:
    """A parameter that is given by its name. hint: its type, as Python that type checkers read."""
    # options of the command line by their keywords
    text = re.sub(r"--([a-z-]+)", lambda found: found[1].replace("-", "_"), help)
    return Keyword(name, default=default, annotation=hint, help=text)


def keywords_of(record: Any, *names: str, flags: bool = False) -> dict[str, Parameter]:
    """Fields of a dataclass, or some of them, as keywords of functions. flags: also by the names of their flags on the
    command line, where these differ.
    """
    options, found = declared(record), dict[str, Parameter]()
    for item in (item for item in fields(record) if item.name in names or not names):
        option = options.get(item.name)
        hint = option.kind.hint if option else str(item.type).replace("Triple", "Numbers")
        hint += " | None" * bool(option and hint and item.default is None)
        text = option.summary or option.kind.expected if option else item.metadata.get("help", "")
        # their choices, unless the help or a page lists them
        choices = [] if "…" in text else [repr(name) for name in option.choices if name] if option else []
        text += f": {', '.join(choices)}" * (1 < len(choices) <= MOST_CHOICES)
        found[item.name] = keyword(item.name, hint, None if item.default is MISSING else item.default, text)
        if flags and option and option.flag:
            is_bare, flag = option.is_bare, flag_name(option)
            same = f"{item.name}={option.bare!r}" if is_bare else item.name
            found[flag] = keyword(flag, "bool" if is_bare else hint, False if is_bare else item.default, f"as {same}")
    return found


def flag_name(option: Option) -> str:
    """Name of an option's flag, as that of a keyword."""
    return option.flag.removeprefix("--").replace("-", "_")


def by_fields(options: Mapping[str, Any], *records: Any) -> dict[str, Any]:
    """Options by the names of fields, of options some of which have the names of flags."""
    flags = {flag_name(o): (name, o) for record in records for name, o in declared(record).items() if o.flag}
    found = {name: value for name, value in options.items() if name not in flags}
    for name, option in (flags[name] for name in options if name in flags):
        value = options[flag_name(option)]
        if not option.is_bare:
            found[name] = value
        elif checked(ValueKind.flag(), flag_name(option), value):
            found[name] = option.bare
    return found


class OptionSignature(Signature):
    """A signature with keywords, for completion; its text has `**options`, as the docstring has a line of each."""

    def __str__(self) -> str:
        plain = [item for item in self.parameters.values() if not isinstance(item, Keyword)]
        defaults = {item.name: "" if item.default is item.empty else f" = {item.default!r}" for item in plain}
        hints = {item.name: "" if item.annotation is item.empty else f": {item.annotation}" for item in plain}
        lines = [f"    {item.name}{hints[item.name]}{defaults[item.name]},\n" for item in plain]
        back = "" if self.return_annotation is self.empty else f" -> {self.return_annotation}"
        rest = "**given" if "options" in hints else "**options"
        return (f"(\n{''.join(lines)}    {rest},\n)" if lines else f"({rest})") + back


def describe_keywords(sections: Mapping[str, Mapping[str, Parameter]]) -> str:
    """A line of each keyword, with its default, below the titles of sections."""
    lines = []
    for title, table in sections.items():
        lines += ["", f"{title}:", ""] if table else []
        for name, item in table.items():
            text = f"{name}={item.default!r}: {getattr(item, 'help', '')}".removesuffix(": ")
            lines.append(f"    {shorten(text, LONGEST_LINE, placeholder=' …')}")
    return "\n".join(lines)


def with_keywords(
    table: Mapping[str, Parameter], sections: Mapping[str, Mapping[str, Parameter]] | None = None
) -> Callable[[Target], Target]:
    """A decorator that lists keywords in the signature of a function or class in place of its `**options`, for
    completion, and in its docstring, for help. sections: those of the docstring by titles.
    """

    def add(target: Target) -> Target:
        whole = Signature() if isinstance(target, type) else signature(target)
        plain = [item for name, item in whole.parameters.items() if item.kind != item.VAR_KEYWORD and name not in table]
        described = describe_keywords(sections or {"Options, with their defaults": table})
        target.__signature__ = OptionSignature([*plain, *table.values()], return_annotation=whole.return_annotation)
        target.__doc__ = f"{cleandoc(target.__doc__ or '')}\n{described}\n"
        return target

    return add


def check_options(record: Any, prefix: str = "") -> None:
    """Checks each option of a frozen dataclass and stores its plain value. Raises InputError naming the option."""
    for item in fields(record):
        value, default = getattr(record, item.name), item.default
        is_default = value is default or (type(value) is type(default) and value == default)
        if "option" in item.metadata and not is_default:
            object.__setattr__(record, item.name, checked(item.metadata["option"].kind, prefix + item.name, value))


def checked(kind: ValueKind, name: str, value: Any) -> Any:
    """The stored value for a value of a kind. Raises InputError naming the option."""
    try:
        return kind.check(value)
    except InputError:
        raise
    except (TypeError, ValueError) as error:
        raise expected(name, kind.expected, repr(value)[:80]) from error


def non_default(record: Any) -> dict[str, Any]:
    """Fields of a dataclass that differ from their defaults."""
    return {f.name: value for f in fields(record) if (value := getattr(record, f.name)) != f.default}


def reject_unknown(what: str, names: Iterable[str], known: Iterable[str], this: str = "") -> None:
    """InputError for names that are not known. this: a description of the known names."""
    known = list(known)
    unknown = [name for name in names if name not in known]
    if unknown:
        fix = nearest(unknown[0], known)
        raise expected(what, this or f"keys {', '.join(known)}", ", ".join(unknown), fix)


class OptionGroup:
    """Some keywords of pictures as an object. options: the given ones by their names. known: parameters of all. record:
    a dataclass that checks values. Raises InputError for other names and values.
    """

    known: ClassVar[Mapping[str, Parameter]] = {}
    record: ClassVar[Any] = None

    def __init__(self, **options: Any) -> None:
        reject_unknown(type(self).__name__, options, self.known)
        if self.record is not None:
            self.record(**{name: value for name, value in options.items() if name in declared(self.record)})
        self.options = options

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(f'{name}={value!r}' for name, value in self.options.items())})"


# end of notes on what a limit of splatgl, not a choice, leaves out of a picture
LIMITED = "(a limit, changes the picture)"


def no_effect(names: Iterable[str], why: str) -> list[str]:
    """A note on options without effect, in a list; [] without names."""
    listed = ", ".join(names)
    return [f"{listed}: no effect, as {why}"] if listed else []


# options and commands, with a value where one is meant, and the words for them in 3D Slicer, ParaView, PyVista, VTK,
# napari, Fiji and F3D; of several options for a word, the first that is there
MEANINGS = {
    "blend mip": "mip maximum max-intensity max-projection maximum-intensity-projection max projection",
    "blend minip": "minip minimum min-intensity min-projection minimum-intensity-projection",
    "blend mean": "mean average mean-projection average-intensity-projection",
    "blend xray": "xray x-ray drr additive sum radiograph sum-slices",
    "blend": "blend-mode blending rendering render-mode volume-blend-mode projection-mode",
    "iso": "isosurface iso-surface isosurfaces isovalue iso-value iso-threshold isovalues contour contours level-set",
    "slice": "slices mpr reslice orthoslice orthoslices slice-index orthogonal-views cross-section section",
    "slice-plane": "slice-planes show-slice slice-in-3d slice-view-3d textured-plane",
    "clip": "cut clip-plane clipping clipping-plane clip-planes cutplane cut-plane cutaway clip-box section",
    "points": "opacity alpha opacities scalar-opacity opacity-function opacity-transfer-function otf",
    "colormap": "cmap lut palette color-map colour-map lookup-table color-function color-transfer-function ctf",
    "window": "clim clims contrast-limits display-range scalar-range color-range data-range limits min-max contrast "
    "gamma brightness",
    "level-width": "window-level level-window wl ww windowing window-width window-center window-center-width",
    "gradient": "gradient-opacity gradient-opacity-function",
    "log": "log-scale logscale logarithmic log-norm use-log-scale",
    "unit": "opacity-unit-distance scalar-opacity-unit-distance unit-distance opacity-unit",
    "color-of": "channel-color channel-colors channel-colour",
    "window-of": "channel-window channel-clim channel-contrast",
    "background transparent": "transparent transparency alpha-background",
    "background": "bg bgcolor bg-color background-color background-colour backdrop",
    "dpi": "ppi dots-per-inch print-resolution",
    "size": "resolution window-size windowsize image-size geometry canvas-size screen-size res",
    "view": "viewpoint standard-view camera camera-view view-direction camera-direction show open display gui",
    "azimuth": "rotate rotation rotate-z yaw azim camera-azimuth-angle azimuth-angle heading rz",
    "elevation": "pitch tilt elev camera-elevation-angle elevation-angle rx",
    "eye": "camera-position cpos position camera-eye camera-location",
    "look-at": "focal-point focalpoint focus lookat camera-focal-point camera-target center",
    "up": "view-up viewup up-vector camera-view-up",
    "zoom": "zoom-factor camera-zoom-factor magnification magnify dolly",
    "fov": "view-angle viewangle field-of-view camera-view-angle angle-of-view",
    "orthographic": "ortho parallel parallel-projection camera-orthographic orthogonal",
    "annotate scale": "scale-bar scalebar ruler scale-legend",
    "annotate colorbar": "colorbar color-bar colour-bar scalar-bar scalarbar show-scalar-bar bar",
    "annotate legend": "legend show-legend channel-legend segment-legend",
    "annotate axes": "axes axis show-axes triad orientation-marker orientation-axes axes-widget",
    "annotate box": "box bounding-box outline show-bounds bounds show-box",
    "annotate directions": "directions orientation-labels anatomical-labels",
    "annotate title=TEXT": "title text caption add-text corner-annotation",
    "crop": "roi voi subvolume sub-volume extract-subset extent crop-box cropping",
    "mask": "stencil masks mask-volume",
    "layer": "overlay layers add-volume second-volume",
    "labels": "segmentation segmentations seg labelmap label-map segments label-volume label-image",
    "only-labels": "segment selected-segments show-labels visible-labels",
    "mesh": "model models polydata stl add-mesh meshes geometry-file",
    "array": "variable var scalars dataset scalar-name array-name coloring-array",
    "channel": "channels channel-axis component channel-index",
    "time": "timestep time-step timepoint time-point time-index time-value frame-index",
    "spacing": "voxel-size voxelsize pixel-size pixelsize voxel-spacing pixel-spacing",
    "dtype": "scalar-type data-type datatype pixel-type voxel-type",
    "shape": "dims dimensions dim grid-size matrix-size",
    "shading": "shade shaded",
    "light": "lighting lights light-kit",
    "light-from": "light-position light-direction light-dir sun",
    "ambient-occlusion": "ao ssao",
    "shadows": "shadow shadow-mapping",
    "antialias": "aa anti-aliasing antialiasing anti-alias fxaa",
    "tolerance": "quality accuracy precision sampling sample-distance",
    "samples": "msaa ssaa multisampling multi-samples supersampling aa-samples",
    "preset": "volume-property transfer-preset look",
    "output": "out save save-as screenshot snapshot export output-file filename",
    "bits": "bit-depth bitdepth",
    "depth": "depth-map zbuffer z-buffer",
    "ref": "reference baseline",
    "workers": "jobs threads n-jobs nproc processes cores",
    "memory": "max-memory mem ram",
    "gpu": "cuda use-gpu hardware hardware-acceleration require-gpu use-cuda",
    "device": "gpu-id gpu-index gpu-device cuda-device device-id",
    "quiet": "silent no-progress",
    "turntable": "orbit rotate-movie 360",
    "fps": "framerate frame-rate",
    "frames": "nframes n-frames number-of-frames",
    "render": "screenshot snapshot draw picture image",
    "animate": "movie video gif turntable animation",
    "compare": "diff difference",
    "info": "describe header inspect stat information",
    "presets": "colormaps looks transfer-functions",
    "convert": "export save-as translate",
}


# options of the command line that are no keywords of pictures, and where Python has them
OF_RENDERERS = {name: f"{name} is an argument of sg.Renderer" for name in ("gpu", "device", "backend")}
# most names that are suggested for an abbreviation
MOST_BEGUN = 3


def nearest(word: str, known: Iterable[str]) -> str:
    """`did you mean …?` by meaning, else by spelling; "" if no known word is near."""
    names = {name.strip("-").replace("_", "-"): name for name in known}
    plain = word.partition("=")[0].strip("-").replace("_", "-").lower()
    meant = [suggestion for suggestion, words in MEANINGS.items() if plain in words.split()]
    of_renderers = next((name for name in (plain, *meant) if name in OF_RENDERERS and "azimuth" in names.values()), "")
    if of_renderers and of_renderers not in names:
        return OF_RENDERERS[of_renderers]
    for name, _, value in (suggestion.partition(" ") for suggestion in meant):
        if name in names:
            form = f"{names[name]} {value}" if names[name].startswith("-") else f"{names[name]}={value!r}"
            return f"did you mean {form if value else names[name]}?"
    # abbreviations before misspellings
    begun = [name for name in names if len(plain) > 1 and name.startswith(plain)]
    similar = [] if meant else begun or get_close_matches(plain, names, 1, SIMILAR)
    return f"did you mean {' or '.join(names[name] for name in similar[:MOST_BEGUN])}?" if similar else ""


def read_pairs(text: str) -> tuple[tuple[float, float], ...]:
    """Pairs of numbers A:B, separated by commas. Raises ValueError for other text."""
    return tuple((float(a), float(b)) for a, b in (part.split(":") for part in text.split(",")))
