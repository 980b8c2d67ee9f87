"""`load`: reads a volume of any format; `FORMATS` in options.py has one row for each."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

from splatgl.coercion import public
from splatgl.data.scenes import SCENES
from splatgl.data.volume import Volume
from splatgl.errors import InputError, MissingOption, error_prefix, expected, warn
from splatgl.fileio import require_existing
from splatgl.options import keywords_of, reject_unknown, with_keywords
from splatgl.plugins import find_function, load_plugins
from splatgl.readers.common import silence_libraries
from splatgl.readers.contents import FIXES, UNKNOWN, describe_bytes, identify, is_n5, is_pattern
from splatgl.readers.heightmap import terrain_from_heights
from splatgl.readers.label_table import load_label_table
from splatgl.readers.options import FORMATS, Format, LoadOptions, converter, inside
from splatgl.readers.remote import Remote, address_name, is_address

if TYPE_CHECKING:
    from splatgl.keywords import LoadKeywords

__all__ = ["FORMATS", "Format", "LoadOptions", "find_labels", "list_volumes", "load", "terrain_from_heights"]


def _import_function(place: Any) -> Any:
    return find_function(place, __name__)


def formats() -> tuple[Format, ...]:
    """FORMATS, and those of other packages."""
    return *FORMATS, *load_plugins("readers", Format)


# most characters of a message after the path: some quote the file
LINE_LIMIT = 400


def load_source(source: str, **options: Any) -> Volume:
    """The volume of a built-in scene, or, with options, of a file or address, as of `load`."""
    return SCENES[source]() if source in SCENES and not options else load(source, **options)


@with_keywords(keywords_of(LoadOptions))
@public
def load(path: str | Path, options: LoadOptions | None = None, **given: Unpack[LoadKeywords]) -> Volume:
    """Loads the volume in a file or Zarr folder, or at an address (https, s3, gs); the contents select the reader.

    path: see `FORMATS` for the endings; an address without ending is a Zarr store, whose chunks are read when needed.
    A 2-D picture or CSV becomes a terrain. FILE.h5:/NAME stands for array="/NAME". Further keywords are fields of
    `LoadOptions`. Samples are memory-mapped where possible; the name is the file's stem. Warns (InputWarning) of what
    the file does not say or the reader leaves out: the volume's `notes`. Raises InputError, which begins with the path,
    for a file or an option that makes no volume.

    ```python
    volume = sg.load("neuron.tif", spacing=(0.5, 0.5, 2.0))
    print(volume)
    ```
    """
    source, array = inside(str(path))
    path = source if is_address(source) else Path(source)
    if not any(_suffix(Path(path), form) for form in FORMATS):
        # which may warn of faulty packages
        formats()
    try:
        with silence_libraries():
            if array is not None:
                given.setdefault("array", array)
            names = [field.name for field in fields(LoadOptions)]
            reject_unknown("options", sorted(given), names, f"some of {', '.join(names)}")
            load_options = replace(options or LoadOptions(), **given)  # type: ignore[arg-type]
            if isinstance(load_options.time, str):
                first = load(str(path), replace(load_options, time=None))
                load_options = replace(load_options, time=first.time_number(load_options.time))
            volume = _load_remote(str(path), load_options) if is_address(path) else _load(Path(path), load_options)
    except InputError as error:
        raise with_path(path, error) from error.__cause__
    except OSError as error:
        raise with_path(path, InputError(f"cannot be read: {error.strerror or error}")) from error
    except MemoryError as error:
        raise with_path(path, InputError("needs more memory than available; use a smaller volume")) from error
    warn(volume.notes, path)
    return volume


def require_source(source: str) -> None:
    """Raises InputError, as `load`, for a path that does not exist."""
    path = Path(inside(source)[0])
    if not (is_address(source) or is_pattern(path)):
        require_existing(path, f"{path}: path")


def list_volumes(path: str | Path) -> list[str]:
    """A line for each volume in a file or folder with several (DICOM series, HDF5 datasets); [] if unreadable."""
    try:
        with silence_libraries():
            form = None if is_address(path) else _find_format(Path(path), LoadOptions())
            return _import_function(form.list_volumes)(Path(path)) if form and form.list_volumes else []
    except (InputError, OSError, MemoryError):
        return []


def find_labels(path: Path, options: LoadOptions, name: str) -> str | None:
    """The `array` of the labels of that name for an image in a Zarr store; None if the path is no such store."""
    try:
        with silence_libraries():
            is_zarr = path.exists() and _find_format(path, options).reader == "ome_zarr.read"
            return _import_function("ome_zarr.find_labels")(path, options, name) if is_zarr else None
    except InputError as error:
        raise with_path(path, error) from error.__cause__


def _load(path: Path, options: LoadOptions) -> Volume:
    if not is_pattern(path):
        require_existing(path, "path")
    form = _find_format(path, options)
    _check_file(path, form, options)
    named = next((known for known in FORMATS if _suffix(path, known) not in ("", ".zip")), form)
    other = form.reader != named.reader and not _suffix(path, form) and path.is_file()
    note = f"its contents are {form.title}, not what its name says" if other else ""
    with error_prefix(note) if note else nullcontext():
        volume = _import_function(form.reader)(path, options, *form.own_options(options))
    volume = _apply_name(replace(volume, notes=(note, *volume.notes)) if note else volume, path.name, form, options)
    if volume.labels or options.values == "amounts":
        return volume
    table = load_label_table(path, path.name[: len(path.name) - len(_suffix(path, form))])
    rounded = None if table is None else volume.rounded()
    return volume if rounded is None else replace(rounded, labels=table)


def _load_remote(address: str, options: LoadOptions) -> Volume:
    """The volume at an address: a copy of the file, or of the needed parts of a Zarr store."""
    from splatgl.readers import ome_zarr

    name, remote = address_name(address), Remote(address)
    if any(_suffix(Path(name), form) for form in FORMATS if "file" in form.kinds):
        return _load(remote.file(), options)
    form = next(form for form in FORMATS if form.reader == "ome_zarr.read")
    _reject_options(form, options)
    volume = ome_zarr.read(remote.store(), options, remote)
    return _apply_name(volume, name, form, options)


def _apply_name(volume: Volume, name: str, form: Format, options: LoadOptions) -> Volume:
    """The volume with the file's name, and with the spacing and meaning of values that the options state."""
    if options.spacing is not None:
        # where the file does not know its spacing, the levels do not either
        alone: dict[str, Any] = {"spacing": options.spacing, "coarser": (), "whole": None}
        channels = tuple(replace(channel, **alone) for channel in volume.channels)
        volume = replace(volume, channels=channels, **alone)
    if options.values not in (None, "heights"):
        volume = volume.of_values(options.values)
    suffix = _suffix(Path(name), form)
    return replace(volume, name=(name[: -len(suffix)] if suffix else name).removesuffix(".ome"))


def with_path(path: Path | str, error: InputError) -> InputError:
    """The error as one line that begins with the path, with text of a damaged header shortened and sanitized."""
    message = str(error)
    short = message if len(message) <= LINE_LIMIT else message[: LINE_LIMIT - 1] + "…"
    line = "".join(c if c.isprintable() else "?" for c in f"{path}: {short}")
    return MissingOption(line, error.option, error.choices) if isinstance(error, MissingOption) else InputError(line)


def _find_format(path: Path, options: LoadOptions) -> Format:
    """The format of a path: by the contents where they are of a known kind, else by the name."""
    named = next((form for form in FORMATS if _suffix(path, form)), None)
    other = None if named else next((form for form in load_plugins("readers", Format) if _suffix(path, form)), None)
    if other:
        return other
    kind = "folder" if path.is_dir() or is_pattern(path) else "file"
    detectable = [form for form in FORMATS if form.detect and kind in form.kinds]
    if kind == "folder":
        default = None if is_pattern(path) else named
        form = next((form for form in detectable if _import_function(form.detect)(path)), default)
        if form is None:
            names = " or ".join(form.title for form in detectable)
            if is_pattern(path):
                raise expected("pattern", "at least two pictures", "fewer", "check the names")
            fix = converter(".n5") if is_n5(path) else "name a file in it"
            raise expected("path", f"a file, or a folder of {names}", "N5" if is_n5(path) else "another folder", fix)
        return form
    if path.exists() and not path.is_file():
        raise expected("path", "a file", "a pipe or device", "save it to a file first")
    has_bytes = path.is_file() and path.stat().st_size > 0
    contents = identify(path) if has_bytes else ""
    if named and (
        not has_bytes or contents in (named.title, *named.signatures) or (not contents and "?" in named.signatures)
    ):
        return named
    if (
        named
        and "*" in named.signatures
        and (not contents or _import_function("raw.states_samples")(path.name, options))
    ):
        return named
    # of packed data that are too short only the name tells
    candidates = [form for form in FORMATS if contents in (form.title, *form.signatures) and contents not in UNKNOWN]
    closer = (form for form in candidates or detectable if form in detectable and _import_function(form.detect)(path))
    form = next(closer, next(iter(candidates), None))
    return form or _reject_contents(path, named, contents)


def _reject_contents(path: Path, named: Format | None, contents: str) -> Format:
    """Raises InputError for a file whose contents are of no format, and not what its name says."""
    fix = FIXES.get(contents, "")
    if named:
        got = contents or describe_bytes(path)
        raise expected("contents", f"{named.title}, as the name says", got, fix or "rename or convert the file")
    known, advice = ", ".join(suffix for form in formats() for suffix in form.suffixes), converter(path.name)
    this = "one that is read" if fix or advice else f"known contents, or a name that ends in one of {known}"
    got = contents or repr("".join(path.suffixes[-2:]))
    raise expected("format", this, got, fix or advice or "convert it")


def _suffix(path: Path, form: Format) -> str:
    """The ending of a name by which a format is known; "" for other names."""
    return next((suffix for suffix in form.suffixes if path.name.lower().endswith(suffix)), "")


def _check_file(path: Path, form: Format, options: LoadOptions) -> None:
    """Raises InputError for no bytes, another format and unsupported options, before any reader runs."""
    kind = "folder" if path.is_dir() or is_pattern(path) else "file"
    if kind not in form.kinds:
        raise expected("path", f"a {form.title} folder" if "file" not in form.kinds else "a file", f"a {kind}")
    if kind == "file" and path.stat().st_size == 0 and "no bytes" not in form.signatures:
        raise expected("file", "data", "0 bytes", "the file is empty")
    _reject_options(form, options)


def _reject_options(form: Format, options: LoadOptions) -> None:
    """Raises InputError for options that the format doesn't support."""
    if options.values == "heights" and "relief" not in form.options:
        raise expected("values", f"labels or amounts for {form.title}", "heights")
    known = (*(() if "point_size" in form.options else ("spacing", "values")), *form.options, *["own"] * bool(form.own))
    refused = sorted(options.given - set(known))
    if refused:
        raise expected("options", f"some of {', '.join(known)} for {form.title}", ", ".join(refused))
