"""Values of DICOM by vendors: mosaics and headers of Siemens, and standardized uptake values.

Tags: (0019,100A) number of slices; (0051,100B) acquisition matrix; (0029,1010) the CSA header of the image.

SUV = activity concentration · body weight / injected dose at the time to which the values are decay-corrected. Sources:
PS3.3 C.8.9.1, and the pseudo-code of the Quantitative Imaging Biomarkers Alliance for the three large vendors.
"""

from __future__ import annotations

import math
import re
import struct
from dataclasses import dataclass
from datetime import datetime
from typing import Any

import numpy as np

from splatgl.data.volume import Hints

COUNT, MATRIX, CSA = 0x0019100A, 0x0051100B, 0x00291010
# most slices of a mosaic
MOST_TILES = 1024
# entry of a CSA header: name, multiplicity, type, code, number of items, code
_ENTRY = struct.Struct("<64si4siii")
# first bytes of version 2; version 1, of scanners before 2004, has its entries 8 bytes earlier
_VERSION_2 = b"SV10"
# third number of an item, last of an entry
_MARKS = (77, 205)
# most entries
_MOST_ENTRIES = 1000
# how descriptions differ, of which the first is version 2's: an item's length by its second number, or by the first
# less the number of items of the first entry, where items end at a negative length (SPM); texts padded by up to three
# bytes, or by one to four
_LAYOUTS = ((1, 3), (0, 3), (1, 4), (0, 4))


@dataclass(frozen=True)
class Mosaic:
    """A mosaic of (rows, columns) in all with `tiles` slices, row by row; 1 of other images. normal: of the slices in
    LPS, from each to the next, or () if the header does not state it.
    """

    size: tuple[int, int]
    tiles: int = 1
    normal: tuple[float, ...] = ()

    @property
    def side(self) -> int:
        """Slices along a side."""
        return math.isqrt(self.tiles - 1) + 1

    @property
    def plane(self) -> tuple[int, int]:
        """(rows, columns) of a slice."""
        return self.size[0] // self.side, self.size[1] // self.side

    def tile(self, number: int) -> tuple[slice, slice]:
        """Rows and columns of a slice."""
        (rows, columns), (down, right) = self.plane, divmod(number, self.side)
        return slice(down * rows, (down + 1) * rows), slice(right * columns, (right + 1) * columns)

    def places(
        self, corner: Any, orientation: Any, spacing: tuple[float, float] | None, step: float | None
    ) -> list[tuple[float, ...] | None]:
        """Positions of the slices, None if anything is unknown. corner: ImagePositionPatient, of an image of the
        mosaic's size around the middle of the first slice. spacing: (x, y) of pixels.
        """
        if corner is None or orientation is None or spacing is None or step is None:
            return [None] * self.tiles
        axes = np.array(orientation).reshape(2, 3)
        normal = np.cross(*axes)
        if self.normal and np.dot(self.normal, normal) < 0:
            normal = -normal
        margins = np.subtract(self.size, self.plane)[::-1] / 2 * spacing
        return [tuple((corner + margins @ axes + n * abs(step) * normal).tolist()) for n in range(self.tiles)]


def find_mosaic(tags: Any, rows: int, columns: int) -> tuple[Mosaic, tuple[str, ...]]:
    """The mosaic of an image, of one tile for other images, and a note on it."""
    value = _value(tags, COUNT)
    stated = int.from_bytes(value[:2], "little") if isinstance(value, bytes) else value
    counts = [stated] if isinstance(stated, int) else csa_numbers(tags, "NumberOfImagesInMosaic")
    matrix = _value(tags, MATRIX)
    size = re.match(r"0*([1-9]\d{0,3})[ps]?\*", matrix.decode("latin-1") if isinstance(matrix, bytes) else str(matrix))
    is_mosaic = "MOSAIC" in map(str, tags.get("ImageType") or ())
    if str(tags.get("NumberOfFrames") or 1) != "1":
        return Mosaic((rows, columns)), ()
    tiles = int(counts[0]) if counts else (rows // int(size[1])) ** 2 if is_mosaic and size else 0
    side = math.isqrt(max(tiles, 1) - 1) + 1
    if not 1 < tiles <= MOST_TILES or rows % side or columns % side or 0 in (rows, columns):
        note = "a mosaic is rendered as one image: the header states no valid number of slices"
        return Mosaic((rows, columns)), (note,) * is_mosaic
    normal = csa_numbers(tags, "SliceNormalVector")
    normal = normal if len(normal) == 3 else ()
    notes = [f"a mosaic is split into {tiles} slices of {columns // side} × {rows // side}"]
    notes += ["the order of its slices is not stated: along the normal"] * (not normal)
    notes += ["the number of its slices is not stated: the last ones may be empty"] * (not counts)
    return Mosaic((rows, columns), tiles, normal), ("; ".join(notes),)


def _value(tags: Any, tag: int) -> Any:
    """The value of a private tag, None without it."""
    return getattr(tags.get(tag), "value", None)


def csa_numbers(tags: Any, name: str) -> tuple[float, ...]:
    """The numbers, at most three, of an entry of the CSA header, () without them."""
    data = _value(tags, CSA)
    many, texts = (_read_entries(data) if isinstance(data, bytes) else {}).get(name, (0, []))
    try:
        numbers = tuple(float(text) for text in texts[: min(many, 3)])
    except ValueError:
        return ()
    return numbers if all(map(math.isfinite, numbers)) else ()


def _read_entries(data: bytes) -> dict[str, tuple[int, list[bytes]]]:
    """Entries by name: how many items count, and all; by the layout in which every entry and item has its mark."""
    is_second = data.startswith(_VERSION_2)
    data = data[8 * is_second :]
    if len(data) < 8 + _ENTRY.size:
        return {}
    count, first = int.from_bytes(data[:4], "little"), _ENTRY.unpack_from(data, 8)[4]
    for layout in _LAYOUTS[: 1 if is_second else None] if 0 < count <= _MOST_ENTRIES else ():
        entries, at = dict[str, tuple[int, list[bytes]]](), 8
        while len(entries) < count and (found := _read_entry(data, at, layout, first)):
            name, many, texts, at = found
            entries[name] = many, texts
        if len(entries) == count:
            return entries
    return {}


def _read_entry(data: bytes, at: int, layout: tuple[int, int], first: int) -> tuple[str, int, list[bytes], int] | None:
    """Name, multiplicity and texts of the entry at a byte, and the byte behind it; None if it lacks a mark.

    An item of an entry: four numbers, and its text. layout: of `_LAYOUTS`; first: items of the first entry.
    """
    if len(data) < at + _ENTRY.size:
        return None
    title, many, _, _, count, mark = _ENTRY.unpack_from(data, at)
    at, texts, (word, padding) = at + _ENTRY.size, list[bytes](), layout
    for _ in range(count if mark in _MARKS else 0):
        numbers = struct.unpack_from("<4i", data, at) if len(data) >= at + 16 else (0, 0, 0, 0)
        if numbers[2] not in _MARKS:
            return None
        at, size = at + 16, numbers[word] - (0 if word else first)
        if size < 0:
            break
        texts.append(data[at : at + size].split(b"\0")[0].strip())
        at += size + (-size % 4 if padding == 3 else 4 - size % 4)
    return (title.split(b"\0")[0].decode("latin-1"), many, texts, at) if mark in _MARKS else None


# Philips' factors from stored values to SUV and to Bq/ml
PHILIPS_SUV, PHILIPS_ACTIVITY = 0x70531000, 0x70531009
SUV = "values are SUV by body weight"
# seconds of a day
_DAY = 86400
# least plausible injected dose in Bq: some programs write megabecquerels
_LEAST_DOSE = 1e5


# SUV at the upper end of the colours: tumours, brain and bladder reach it
CLINICAL_TOP = 10.0
# percentile that is the upper end in other units: injection sites and bladder are far above the rest
BRIGHT = 99.5
# values along each axis for it
SAMPLED = 64
# of angiograms: vessels in red
ANGIOGRAM = Hints(preset="mr-angio", colormap="arteries")
# (share of the upper end, opacity per mean spacing): the body is a veil, uptake is dense
UPTAKE = ((0.05, 0.0), (0.15, 0.004), (0.3, 0.06), (0.6, 0.6), (1.0, 0.95))
# the same of a dose: what is irradiated little is clear, so that layers below it show
DOSE = ((0.1, 0.0), (0.5, 0.01), (0.8, 0.06), (1.0, 0.3))


def value_hints(modality: str, samples: np.ndarray, unit: str) -> Hints:
    """Hints for PET, hot metal from 0 up to CLINICAL_TOP or the brightest, and for doses, from 0 to the largest; none
    for other images.
    """
    steps = [max(count // SAMPLED, 1) for count in samples.shape]
    some = samples[:: steps[0], :: steps[1], :: steps[2]] if modality == "PT" and unit != "SUV" else samples
    finite = some[np.isfinite(some)] if modality in ("PT", "RTDOSE") else np.zeros(0)
    top = float(finite.max() if some is samples else np.percentile(finite, BRIGHT)) if finite.size else 0.0
    top = min(top, CLINICAL_TOP) if unit == "SUV" else top
    if not top > 0:
        return Hints()
    shares, colormap = (UPTAKE, "hot") if modality == "PT" else (DOSE, "spectrum")
    points = tuple((share * top, opacity) for share, opacity in shares)
    return Hints(points=points, window=(0.0, top), colormap=colormap, shading=False)


# words of descriptions of angiograms by magnetic resonance, and contrasts of enhanced ones (PS3.3 C.8.13.3.1.3)
ANGIO, CONTRASTS = re.compile(r"(?<![a-z])(tof|mra|angio\w*)(?![a-z])"), ("TOF", "FLOW_ENCODED")


def is_angiogram(tags: Any) -> bool:
    """Whether images show vessels by X-rays, or by magnetic resonance as flag, contrast or description say."""
    names = ("Modality", "AngioFlag", "AcquisitionContrast", "SeriesDescription")
    modality, flag, contrast, about = (str(tags.get(name) or "").strip() for name in names)
    if modality != "MR":
        return modality == "XA"
    return flag == "Y" or contrast in CONTRASTS or bool(ANGIO.search(about.lower()))


def suv_factor(tags: Any) -> tuple[float, str]:
    """The factor from rescaled values to SUV by body weight, and a note; 1 if the header does not permit it."""
    units = str(tags.get("Units") or "").strip().upper()
    if units == "GML":
        kind = str(tags.get("SUVType") or "BW").strip().upper()
        return 1.0, SUV if kind == "BW" else f"values are SUV by {kind}, not by body weight"
    if units == "CNTS":
        stated, activity = _number(tags.get(PHILIPS_SUV)), _number(tags.get(PHILIPS_ACTIVITY))
        if stated > 0:
            return stated, f"{SUV}, by the vendor's factor"
        if not activity > 0:
            return 1.0, "values are counts, not SUV: the header has no factor to Bq/ml"
        source = "counts by the vendor's factor"
    elif units == "BQML":
        activity, source = 1.0, "Bq/ml by the header's weight, dose and decay"
    else:
        return 1.0, f"values are in {units or 'an unknown unit'}, not SUV"
    factor, reason = _from_activity(tags)
    return (factor * activity, f"{SUV}, from {source}") if factor else (1.0, f"values are as stored, not SUV: {reason}")


def _from_activity(tags: Any) -> tuple[float, str]:
    """The factor from Bq/ml to SUV, or 0 and the reason why the header does not permit it."""
    weight = _number(tags.get("PatientWeight"))
    item: Any = next(iter(tags.get("RadiopharmaceuticalInformationSequence") or ()), {})
    dose, half_life = (_number(item.get(f"Radionuclide{name}")) for name in ("TotalDose", "HalfLife"))
    corrected = tags.get("CorrectedImage")
    corrections = {corrected} if isinstance(corrected, str) else set(map(str, corrected or ()))
    kind = str(tags.get("DecayCorrection") or "").strip().upper()
    reasons = {
        "the header has no weight": not weight > 0,
        "the header has no dose": not dose > 0,
        f"a dose of {dose:g} is not in Bq": dose < _LEAST_DOSE,
        "the images are not corrected for attenuation and decay": bool(corrections)
        and not {"ATTN", "DECY"} <= corrections,
        f"DecayCorrection is {kind or 'missing'}": kind not in ("START", "ADMIN"),
    }
    reason = next((text for text, holds in reasons.items() if holds), "")
    if reason or kind == "ADMIN":
        return (0.0, reason) if reason else (weight * 1000 / dose, "")
    elapsed = _elapsed(tags, item)
    if elapsed is None or not half_life > 0:
        return 0.0, "the times of injection and scan do not fit" if elapsed is None else "the header has no half-life"
    return weight * 1000 / (dose * 2 ** (-elapsed / half_life)), ""


def _elapsed(tags: Any, item: Any) -> float | None:
    """Seconds from the injection to the start of the scan, None if the header's times do not fit."""
    day, start = tags.get("SeriesDate"), item.get("RadiopharmaceuticalStartTime")
    scan = clock_seconds(day, tags.get("SeriesTime"))
    acquired = clock_seconds(tags.get("AcquisitionDate") or day, tags.get("AcquisitionTime"))
    if not day or acquired < scan:
        # the series was made later, by a reconstruction: values are corrected to another time
        return None
    stated = str(item.get("RadiopharmaceuticalStartDateTime") or "")
    injected = clock_seconds(stated[:8], stated[8:])
    if math.isnan(injected):
        injected = clock_seconds(day, start)
        # before midnight
        injected -= _DAY * (injected > scan)
    return scan - injected if 0 <= scan - injected < _DAY else None


def clock_seconds(day: Any, clock: Any) -> float:
    """Seconds of a time HHMMSS.F, without its zone, from the begin of the calendar on where the day YYYYMMDD is known;
    NaN without a time, and for other texts.
    """
    # older files have signs between the numbers
    date, time = str(day or "").strip().replace(".", ""), str(clock or "").strip().replace(":", "")
    whole, _, part = re.split("[-+&]", time)[0].partition(".")
    try:
        moment = datetime.strptime(f"{whole:0<6}", "%H%M%S") if whole else None
        days = datetime.strptime(date, "%Y%m%d").toordinal() if date else 0
        seconds = math.nan if moment is None else moment.hour * 3600 + moment.minute * 60 + moment.second
        return days * _DAY + seconds + float(f"0.{part or 0}")
    except ValueError:
        return math.nan


def _number(value: Any) -> float:
    """The number of a tag, also of an element, and of an unknown one in bytes; NaN without one."""
    value = getattr(value, "value", value)
    try:
        return float(value.decode().strip(" \0") if isinstance(value, bytes) else value)
    except (TypeError, ValueError):
        return math.nan
