"""Segmentations and contours of DICOM, written by pydicom."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from splatgl.data.volume import Volume
from tests.fuzz.seed_dicom import image, save
from tests.fuzz.seed_files import CUBE, Seed, written

SEG, STRUCTURES = "1.2.840.10008.5.1.4.1.1.66.4", "1.2.840.10008.5.1.4.1.1.481.3"
# 7 rows and columns: frames of 49 bits do not end at bytes
SHAPE, STEP = (8, 7, 7), 3.0
NAMES = ("Liver", "Tumour", "Vessel")
COLORS = ([43803, 26565, 37722], [34885, 53485, 50171], None)


def item(**tags: object) -> Any:
    from pydicom.dataset import Dataset

    found = Dataset()
    for name, value in tags.items():
        if value is not None:
            setattr(found, name, value)
    return found


def masks(overlap: bool = True) -> np.ndarray:
    """Three segments [3, D, H, W]; two of them meet, or overlap in one column."""
    found = np.zeros((3, *SHAPE), bool)
    found[0, 2:6, 1:4, 1 : 4 + overlap] = True
    found[1, 4:8, 2:6, 4:6] = True
    found[2, 0, 0, 0] = True
    return found


def segmentation(
    path: Path, of: np.ndarray, kind: str = "BINARY", places: Sequence[float] = (), thick: float = STEP
) -> Path:
    """A SEG of the planes that are not empty, or of labels in all planes."""
    places = places or [STEP * n for n in range(of.shape[1])]
    if kind == "LABELMAP":
        numbers = (of * np.arange(1, len(of) + 1)[:, None, None, None]).max(axis=0).astype(np.uint8)
        chosen, stored = [(0, k) for k in range(of.shape[1])], numbers
    else:
        chosen = [(s, k) for s in range(len(of)) for k in range(of.shape[1]) if of[s, k].any()]
        stored = np.stack([of[s, k] for s, k in chosen]).astype(np.uint8) * (200 if kind == "FRACTIONAL" else 1)
    data = image(stored, Modality="SEG", SOPClassUID=SEG, SegmentationType=kind)
    for name in ("ImagePositionPatient", "ImageOrientationPatient", "PixelSpacing", "SliceThickness"):
        delattr(data, name)
    if kind == "BINARY":
        data.BitsAllocated, data.BitsStored, data.HighBit = 1, 1, 0
        bits = np.packbits(stored.ravel(), bitorder="little").tobytes()
        data.PixelData = bits + b"\0" * (len(bits) % 2)
    data.MaximumFractionalValue = 255
    data.SegmentSequence = [
        item(SegmentNumber=n + 1, SegmentLabel=NAMES[n], RecommendedDisplayCIELabValue=COLORS[n])
        for n in range(len(of))
    ]
    measures = item(PixelSpacing=[2.0, 1.5], SliceThickness=thick)
    orientation = item(ImageOrientationPatient=[1, 0, 0, 0, 1, 0])
    data.SharedFunctionalGroupsSequence = [
        item(PixelMeasuresSequence=[measures], PlaneOrientationSequence=[orientation])
    ]
    data.PerFrameFunctionalGroupsSequence = [
        item(
            PlanePositionSequence=[item(ImagePositionPatient=[10.0, 20.0, places[k]])],
            SegmentIdentificationSequence=[item(ReferencedSegmentNumber=s + 1)],
        )
        for s, k in chosen
    ]
    save(data, path)
    return path


def palette_segmentation(path: Path) -> Path:
    """A SEG of labels with a palette, whose odd length is padded."""
    from pydicom import dcmread

    data = dcmread(segmentation(path, masks(overlap=False), "LABELMAP"))
    data.PhotometricInterpretation = "PALETTE COLOR"
    for n in range(3):
        # red, green and blue: the table's size, first number and bits, and the table
        data.add_new(0x00281101 + n, "US", [5, 0, 8])
        data.add_new(0x00281201 + n, "OW", bytes([n, 255 - n, 100, 8 * n, 7, 0]))
    save(data, path)
    return path


def structures(path: Path, contours: Sequence[tuple[int, str, np.ndarray]]) -> Path:
    """An RTSTRUCT of regions 1, 2, …: number, geometric type and points [N, 3] of each contour."""
    data = image(np.zeros((2, 2), np.uint8), Modality="RTSTRUCT", SOPClassUID=STRUCTURES)
    for name in ("Rows", "Columns", "PixelData", "ImagePositionPatient", "PixelSpacing"):
        delattr(data, name)
    numbers = sorted({number for number, _, _ in contours})
    data.StructureSetROISequence = [item(ROINumber=n, ROIName=NAMES[n - 1]) for n in numbers]
    data.ROIContourSequence = [
        item(
            ReferencedROINumber=n,
            ROIDisplayColor=[255, 128, n],
            ContourSequence=[
                item(ContourGeometricType=kind, ContourData=[f"{v:.4f}" for v in points.ravel()])
                for number, kind, points in contours
                if number == n
            ],
        )
        for n in numbers
    ]
    save(data, path)
    return path


def circle(radius: float, z: float, middle: tuple[float, float] = (40.0, 36.0)) -> np.ndarray:
    angles = np.linspace(0, 2 * np.pi, 72, endpoint=False)
    return np.stack([middle[0] + radius * np.cos(angles), middle[1] + radius * np.sin(angles), np.full(72, z)], -1)


def found_in(volume: Volume) -> dict[str, np.ndarray]:
    """World places [N, 3] of the voxels of each segment, by its name, sorted."""
    found = {}
    for part in volume.channels or (volume,):
        for label in part.labels or ():
            index = np.argwhere(np.asarray(part.samples) == label.number)[:, ::-1]
            places = np.round(index @ part.world_from_index.T + part.origin, 6)
            found[label.name] = places[np.lexsort(places.T)]
    return found


def dicom_segments() -> list[Seed]:
    """Seeds of segmentations of each kind, and of contours."""
    kinds = [partial(segmentation, of=masks(kind != "LABELMAP"), kind=kind) for kind in ("BINARY", "FRACTIONAL")]
    kinds.append(partial(segmentation, of=masks(overlap=False), kind="LABELMAP"))
    contours = [(n, "CLOSED_PLANAR", circle(6, z)) for n in (1, 2) for z in (0.0, 3.0, 6.0)]
    return [
        written("a.dcm", save_one)
        for save_one in (*kinds, palette_segmentation, partial(structures, contours=contours))
    ]


def dicom_words() -> list[Seed]:
    """Seeds of frames in big-endian words, of pixels that share their chroma, and of bits at the top of others."""
    from pydicom.uid import ExplicitVRBigEndian

    words = image(CUBE)
    words.file_meta.TransferSyntaxUID = ExplicitVRBigEndian
    words["PixelData"].VR = "OW"
    shared = image(CUBE[:, :6, :8], SamplesPerPixel=3, PhotometricInterpretation="YBR_FULL_422", PlanarConfiguration=0)
    shared.PixelData = np.repeat(CUBE[:, :6, :8], 2, axis=-1).tobytes()
    top = image(CUBE.astype(np.uint16) << 8, BitsStored=12, HighBit=15, RescaleSlope="0.5")
    return [written("a.dcm", partial(save, data)) for data in (words, shared, top)]
