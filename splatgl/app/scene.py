"""A scene: source, reader options, camera, transfer function and settings; from options or a scene.toml.

volume = "head.nii.gz"          # beside the scene file, or the name of a built-in scene
threshold = 0.0
[load]                          # as LoadOptions
[transfer]                      # preset = "…", or points, colormap, window, scale, unit, gradient, shading
[camera]                        # size, azimuth, elevation, fov, zoom | eye, look_at, up | orthographic, height
[settings]                      # as Settings
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, fields, replace
from math import inf
from numbers import Integral, Real
from pathlib import Path
from typing import TYPE_CHECKING, Any

from splatgl.app.stacks import FLAT, UP, is_flat_stack
from splatgl.data.errors import InputError, expected
from splatgl.data.readers import LoadOptions, load
from splatgl.data.readers.remote import is_address
from splatgl.data.scenes import SCENES
from splatgl.data.toml import load_table
from splatgl.data.volume import Triple, Volume
from splatgl.splat.classification.presets import default_transfer, logarithmic, preset
from splatgl.splat.classification.transfer import Transfer
from splatgl.splat.plan.settings import Settings

# extraction and cameras are imported once there is a volume: bad input is told at once
if TYPE_CHECKING:
    from splatgl.splat.extraction.extract import Progress
    from splatgl.splat.extraction.splats import Splats
    from splatgl.splat.view.camera import Bounded, Camera

# the types of a scene file's keys
KEYS: dict[str, tuple[type, ...]] = {
    "volume": (str,),
    "threshold": (int, float),
    "load": (dict,),
    "transfer": (dict,),
    "camera": (dict,),
    "settings": (dict,),
}
# number of components of camera keys; the others have one, and `orthographic` is true or false
VIEW_COUNTS = {"size": 2, "eye": 3, "look_at": 3, "up": 3}
AZIMUTH, ELEVATION, ELEVATION_FLAT, FOV = 30.0, 20.0, 60.0, 40.0


@dataclass(frozen=True)
class View:
    """Camera parameters; those that are None come from the volume's hints, anatomy or shape."""

    size: tuple[int, int] = (512, 512)
    azimuth: float | None = None
    elevation: float | None = None
    fov: float | None = None
    zoom: float | None = None
    eye: Triple | None = None
    look_at: Triple | None = None
    up: Triple | None = None
    orthographic: bool = False
    height: float | None = None

    def along_z(self, volume: Volume) -> bool:
        """Whether nothing says from where a flat stack is seen: along +z, x to the right and y down."""
        asked = (self.azimuth, self.elevation, self.eye, self.look_at, self.up)
        return all(each is None for each in asked) and is_flat_stack(volume)

    def upwards(self, volume: Volume) -> Triple:
        """The direction that is up in the default view, about which a volume turns."""
        found: Triple = UP if self.along_z(volume) else _first(self.up, volume.hints.up, (0.0, 0.0, 1.0))
        return found

    def camera(self, volume: Volume, subject: Bounded) -> Camera:
        """The camera; an orbit is fitted to what is visible of `subject`."""
        from splatgl.splat.extraction.splats import Splats
        from splatgl.splat.view.camera import Camera

        subject = subject.visible if isinstance(subject, Splats) else subject
        hints = volume.hints
        fov = _first(self.fov, hints.fov, FOV)
        orbits = any(x is not None for x in (self.azimuth, self.elevation, self.zoom))
        if self.eye is not None or (hints.eye is not None and not orbits):
            target = _first(self.look_at, hints.target if self.eye is None else None, tuple(volume.center))
            up = _first(self.up, hints.up, (0.0, 0.0, 1.0))
            camera = Camera.look_at(_first(self.eye, hints.eye), target, up, fov, self.size)
        else:
            if self.look_at is not None:
                raise expected("look_at", "an eye that looks there", "none", "give --eye too")
            flat = self.along_z(volume)
            azimuth, elevation = (0.0, 0.0) if flat else _default_orbit(volume)
            camera = Camera.orbit(
                subject,
                _first(self.azimuth, hints.azimuth, azimuth),
                _first(self.elevation, hints.elevation, elevation),
                fov,
                self.size,
                _first(self.zoom, 1.0),
                UP if flat else _first(self.up, hints.up, (0.0, 0.0, 1.0)),
            )
        parallel = self.orthographic or self.height is not None
        return camera.parallel(subject, self.height) if parallel else camera


@dataclass(frozen=True)
class Scene:
    """A complete description of an image to render."""

    volume: str
    load: Mapping[str, Any] = field(default_factory=dict)
    transfer: Mapping[str, Any] = field(default_factory=dict)
    view: View = field(default_factory=View)
    settings: Settings = field(default_factory=Settings)
    threshold: float = 0.0

    @classmethod
    def from_toml(cls, path: Path) -> Scene:
        """Reads a scene file. Raises InputError for a missing file, bad TOML, and unknown keys."""
        table = load_table(path, "a scene")
        _check_keys(str(path), table, set(KEYS))
        for key, kind in KEYS.items():
            if key in table and not isinstance(table[key], kind):
                raise expected(f"{path}: {key}", " or ".join(k.__name__ for k in kind), repr(table[key]))
        if "volume" not in table:
            raise expected(path, "the key volume", ", ".join(table) or "an empty file")
        source = table["volume"]
        if source not in SCENES and not is_address(source):
            source = str(path.parent / source)
        camera = table.get("camera", {})
        _check_keys(f"{path} [camera]", camera, {f.name for f in fields(View)})
        with _named(f"{path} [camera]"):
            view = View(**{k: typed(k, v) for k, v in camera.items()})
        with _named(f"{path} [settings]"):
            settings = Settings().but(**table.get("settings", {}))
        reading = dict(table.get("load", {}))
        if isinstance(reading.get("color"), str):
            reading["color"] = str(path.parent / reading["color"])
        with _named(f"{path} [load]"):
            _check_keys("load", reading, {f.name for f in fields(LoadOptions)})
            LoadOptions(**reading)
        scene = cls(source, reading, table.get("transfer", {}), view, settings)
        return replace(scene, threshold=float(table.get("threshold", 0.0)))

    def to_toml(self, folder: Path) -> str:
        """TOML text which `from_toml`, reading it from a file in `folder`, parses to the same scene.

        Paths are relative if below `folder`, else absolute. Raises InputError for values that TOML cannot represent.
        """
        known = self.volume in SCENES and not self.load
        reading = dict(self.load)
        if isinstance(reading.get("color"), str):
            reading["color"] = _relative(reading["color"], folder)
        lines = [f"volume = {_toml('volume', self.volume if known else _relative(self.volume, folder))}"]
        if self.threshold:
            lines.append(f"threshold = {_toml('threshold', float(self.threshold))}")
        camera = {**_told(self.view), "size": self.view.size}
        tables = {"load": reading, "transfer": self.transfer, "camera": camera, "settings": self.settings.given}
        for name, table in tables.items():
            given = {key: value for key, value in table.items() if value is not None}
            lines += ["", f"[{name}]"] if given else []
            lines += [f"{key} = {_toml(f'{name} {key}', value)}" for key, value in given.items()]
        return "\n".join(lines) + "\n"

    def anywhere(self) -> Scene:
        """The same scene with absolute paths, for processes in other folders."""
        reading = {name: _absolute(value) if name == "color" else value for name, value in self.load.items()}
        known = self.volume in SCENES and not self.load
        return replace(self, volume=self.volume if known else _absolute(self.volume), load=reading)

    def open(self) -> Volume:
        """The volume: a built-in scene, or a file through its reader."""
        if self.volume in SCENES and not self.load:
            return SCENES[self.volume]()
        return load(self.volume, **self.load)

    def splats(
        self, volume: Volume, transfer: Transfer, progress: Progress | None = None, moving: bool = False
    ) -> Splats:
        """The splats of the scene, classified as its settings say. moving: whether pictures are motion-blurred."""
        from splatgl.splat.plan.suited import extracted

        return extracted(volume, transfer, self.settings, self.threshold, progress, moving)

    def transfer_for(self, volume: Volume) -> Transfer:
        """The transfer function: the data's own or a preset's, overridden by the scene's options."""
        asked = dict(self.transfer)
        name = asked.pop("preset", None)
        if "points" in asked and name is None:
            return Transfer.from_table(asked)
        base = preset(name, volume) if name else default_transfer(volume)
        _check_keys("transfer", asked, {f.name for f in fields(Transfer)})
        if asked.get("scale") == "log" and "points" not in asked:
            base = logarithmic(base, volume)
        return replace(base, **asked)


def _absolute(name: str) -> str:
    """A file's absolute path; an address as it is."""
    return name if is_address(name) else str(Path(name).resolve())


def _relative(path: str, folder: Path) -> str:
    """A file's path in a scene in `folder`: relative if below it, else absolute; an address as it is."""
    if is_address(path):
        return path
    place = Path(path).resolve()
    near = place.relative_to(folder.resolve()).as_posix() if place.is_relative_to(folder.resolve()) else str(place)
    # a file may have the name of a built-in scene
    return f"./{near}" if near in SCENES else near


def _told(record: View) -> dict[str, Any]:
    """The fields that differ from their defaults."""
    values = {f.name: getattr(record, f.name) for f in fields(record)}
    return {f.name: values[f.name] for f in fields(record) if values[f.name] != f.default}


def _toml(what: str, value: Any) -> str:
    """A string, number, boolean, or sequence of them as TOML."""
    if isinstance(value, str):
        # JSON escapes everything that TOML requires, except DEL
        text = json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
        if any("\ud800" <= letter <= "\udfff" for letter in text):
            raise expected(what, "text that TOML can hold", repr(value)[:80])
        return text
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, Integral):
        return str(int(value))
    if isinstance(value, Real):
        return repr(float(value))
    if isinstance(value, Sequence):
        return "[" + ", ".join(_toml(what, part) for part in value) + "]"
    raise expected(what, "text, numbers or lists of them", type(value).__name__)


def _default_orbit(volume: Volume) -> tuple[float, float]:
    """Default azimuth and elevation: anatomy from the front, volumes thinner than FLAT of their width from above."""
    extent = volume.corners.max(axis=0) - volume.corners.min(axis=0)
    elevation = ELEVATION_FLAT if extent[2] < FLAT * min(extent[0], extent[1]) else ELEVATION
    # in RAS the front is +y, in LPS it is −y
    return (180.0 + AZIMUTH if volume.frame == "RAS" else AZIMUTH), elevation


@contextmanager
def _named(what: str) -> Iterator[None]:
    """Adds the location of an invalid value to its error."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{what}: {error}") from error


def typed(name: str, value: Any) -> Any:
    """Type-checked value of a camera key; lists become tuples."""
    if name == "orthographic":
        fine, this = isinstance(value, bool), "true or false"
    else:
        count = VIEW_COUNTS.get(name)
        numbers: list[Any] = value if count and isinstance(value, list) else [value] * (not count)
        kind: Any = int if name == "size" else (int, float)
        fine = len(numbers) == (count or 1)
        fine = fine and all(isinstance(n, kind) and not isinstance(n, bool) and abs(n) < inf for n in numbers)
        this = f"{count or 'one'} {'whole' if name == 'size' else 'finite'} number{'s' if count else ''}"
    if not fine:
        raise expected(name, this, repr(value)[:80])
    return tuple(value) if isinstance(value, list) else value


def _first(*values: Any) -> Any:
    return next((value for value in values if value is not None), None)


def _check_keys(what: str, table: Mapping[str, Any], known: set[str]) -> None:
    unknown = [key for key in table if key not in known]
    if unknown:
        raise expected(what, f"keys {', '.join(sorted(known))}", ", ".join(unknown))
