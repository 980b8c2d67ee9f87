"""Standardized uptake values (SUV by body weight) of PET images.

SUV = activity concentration · body weight / injected dose at the time to which the values are decay-corrected. Sources:
PS3.3 C.8.9.1, and the pseudo-code of the Quantitative Imaging Biomarkers Alliance for the three large vendors.
"""

from __future__ import annotations

import math
import re
from datetime import datetime, timedelta
from typing import Any

import numpy as np

from splatgl.data.volume import Hints

# tags that are read beside those of other images; Philips' factors from stored values to SUV and to Bq/ml
PHILIPS_SUV, PHILIPS_ACTIVITY = 0x70531000, 0x70531009
SUV_TAGS: tuple[str | int, ...] = (
    *("PatientWeight", "RadiopharmaceuticalInformationSequence", "DecayCorrection", "CorrectedImage", "SUVType"),
    *("SeriesDate", "SeriesTime", "AcquisitionDate", PHILIPS_SUV, PHILIPS_ACTIVITY),
)
SUV = "values are SUV by body weight"
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
        factor, reason = _from_activity(tags)
        return (factor * activity, f"{SUV}, from counts by the vendor's factor") if factor else (1.0, _refuse(reason))
    if units != "BQML":
        return 1.0, f"values are in {units or 'an unknown unit'}, not SUV"
    factor, reason = _from_activity(tags)
    return (factor, f"{SUV}, from Bq/ml by the header's weight, dose and decay") if factor else (1.0, _refuse(reason))


def _refuse(reason: str) -> str:
    return f"values are as stored, not SUV: {reason}"


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
        return (
            0.0,
            "the header has no half-life" if elapsed is not None else "the times of injection and scan do not fit",
        )
    return weight * 1000 / (dose * 2 ** (-elapsed / half_life)), ""


def _elapsed(tags: Any, item: Any) -> float | None:
    """Seconds from the injection to the start of the scan, None if the header's times do not fit."""
    scan = _moment(tags.get("SeriesDate"), tags.get("SeriesTime"))
    acquired = _moment(tags.get("AcquisitionDate") or tags.get("SeriesDate"), tags.get("AcquisitionTime"))
    if scan is None or (acquired is not None and acquired < scan):
        # the series was made later, by a reconstruction: values are corrected to another time
        return None
    stated = str(item.get("RadiopharmaceuticalStartDateTime") or "")
    injected = _moment(stated[:8], stated[8:]) if stated else None
    if injected is None:
        injected = _moment(tags.get("SeriesDate"), item.get("RadiopharmaceuticalStartTime"))
        if injected is not None and injected > scan:
            # before midnight
            injected -= timedelta(days=1)
    seconds = None if injected is None else (scan - injected).total_seconds()
    return seconds if seconds is not None and 0 <= seconds < 86400 else None


def _moment(date: Any, time: Any) -> datetime | None:
    """The moment of a date YYYYMMDD and a time HHMMSS.F, without its zone; None without them."""
    day, clock = str(date or "").strip(), str(time or "").strip().split("+")[0].split("-")[0]
    try:
        whole, _, part = clock.partition(".")
        return datetime.strptime(f"{day}{whole:0<6}", "%Y%m%d%H%M%S") + timedelta(seconds=float(f"0.{part or 0}"))
    except ValueError:
        return None


def _number(value: Any) -> float:
    """The number of a tag, also of an element, and of an unknown one in bytes; NaN without one."""
    value = getattr(value, "value", value)
    try:
        return float(value.decode().strip(" \0") if isinstance(value, bytes) else value)
    except (TypeError, ValueError):
        return math.nan
