"""Segmentations of DICOM (SEG, PS3.3 A.51), written by highdicom: one bit for each voxel of the planes that a segment
reaches. Patient, study and frame of reference are those of the images that are named, else new ones.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from splatgl import __version__
from splatgl.data.fills import distinct
from splatgl.data.volume import Label, Volume
from splatgl.errors import expected, list_names, one_line
from splatgl.fileio import byte_count, require_memory
from splatgl.readers.common import silence_libraries
from splatgl.readers.dicom import find_series, largest_group, select_series
from splatgl.readers.dicom_headers import plain_text, read_dataset
from splatgl.readers.dicom_segments import MOST_SEGMENTS
from splatgl.readers.options import LoadOptions
from splatgl.transfer.label_detection import LABELS, MASK, mark_kind
from splatgl.writers import Content, label_colors

# elements of images that highdicom copies, which anonymous ones may lack: those that may be empty, and identifiers
_TEXTS = (
    *("PatientID", "PatientName", "PatientBirthDate", "PatientSex", "AccessionNumber"),
    *("StudyID", "StudyDate", "StudyTime", "ReferringPhysicianName"),
)
_UIDS = ("StudyInstanceUID", "SeriesInstanceUID", "SOPInstanceUID", "FrameOfReferenceUID")
# class of an image that stands for none, and a number of a series that scanners leave free
_CT, _SERIES = "1.2.840.10008.5.1.4.1.1.2", 1000
# largest cosine between axes at right angles
_SQUARE = 1e-4


@silence_libraries()
def write_segmentation(path: Path, content: Content) -> None:
    """Writes a .dcm file of the labels of a volume, or of its channels, which may overlap; notes say what DICOM asks
    for and labels do not have. Raises InputError for amounts, sheared grids and images that are no series.
    """
    volume = content.volume
    if not np.allclose(volume.direction.T @ volume.direction, np.eye(3), atol=_SQUARE):
        raise expected("axes", "axes at right angles in a DICOM segmentation", "sheared ones", "write .nrrd")
    layers = [_as_labels(part) for part in volume.channels or (volume,)]
    segments = _list_segments(layers)
    images = _read_images(content.images) if content.images else [_stand_in(volume)]
    data = _segmentation(volume, _number_segments(layers, segments), [label for _, label in segments], images)
    frames = data.PerFrameFunctionalGroupsSequence
    if not content.images:
        # the image that stands for none is no source
        for part in (data, *frames):
            for name in ("ReferencedSeriesSequence", "SourceImageSequence", "DerivationImageSequence"):
                part.pop(name, None)
    elif not any(frame.get("DerivationImageSequence") for frame in frames):
        content.notes.append(f"no slice of the segments lies on one of {content.images}")
    data.save_as(path)
    content.notes.extend(["the unit is unknown, and DICOM has only mm"] * (not volume.unit))
    content.notes.append("DICOM asks what segments are and who drew them, which labels do not say: Tissue, MANUAL")
    moved = [f"{label.number} is {n}" for n, (_, label) in enumerate(segments, 1) if label.number != n]
    content.notes.extend([f"DICOM numbers segments from 1: {list_names(moved)}"] * bool(moved))


def _segmentation(volume: Volume, numbers: np.ndarray, labels: list[Label], images: list[Any]) -> Any:
    """The data set of segments over images. numbers: as of `_number_segments`. Raises InputError for images that
    highdicom does not take.
    """
    import highdicom as hd
    from pydicom.sr.codedict import codes

    affine, tissue = np.eye(4), codes.SCT.Tissue
    affine[:3, :3], affine[:3, 3] = volume.world_from_index[:, ::-1], volume.origin
    colors = [bytes.fromhex(color[1:]) for color in label_colors(labels)]
    channels = {"SegmentNumber": list(range(1, len(labels) + 1))} if numbers.ndim > 3 else None
    frame = images[0].FrameOfReferenceUID
    grid = hd.Volume(numbers, affine, "PATIENT", frame_of_reference_uid=frame, channels=channels)
    try:
        return hd.seg.Segmentation(
            images,
            grid,
            "BINARY",
            [
                hd.seg.SegmentDescription(
                    number,
                    plain_text(label.name.replace("\\", "/")) or f"Segment {label.number}",
                    tissue,
                    tissue,
                    "MANUAL",
                    display_color=hd.color.CIELabColor.from_rgb(*color),
                )
                for number, (label, color) in enumerate(zip(labels, colors, strict=True), 1)
            ],
            series_instance_uid=hd.UID(),
            series_number=_SERIES,
            sop_instance_uid=hd.UID(),
            instance_number=1,
            manufacturer="splatgl",
            manufacturer_model_name="splatgl",
            software_versions=__version__,
            device_serial_number="0",
            content_label="SEGMENTATION",
            series_description=plain_text(volume.name) or "segmentation",
            specific_character_set="ISO_IR 192",
        )
    except (ValueError, TypeError, AttributeError, KeyError) as error:
        raise expected("images", "images that a segmentation may be of", one_line(error)) from error


def _as_labels(volume: Volume) -> Volume:
    """A volume of labels, or a mask. Raises InputError for amounts."""
    marked = mark_kind(volume)
    if marked.labels is None and marked.hints.values not in (LABELS, MASK):
        fix = "--values labels, if these numbers are names"
        raise expected("samples", "labels in a DICOM segmentation", "amounts", fix)
    return marked


def _list_segments(layers: list[Volume]) -> list[tuple[int, Label]]:
    """(layer, label) of each number that voxels have, ascending."""
    segments = []
    for layer, volume in enumerate(layers):
        numbers = np.zeros(0)
        for slab in volume.slabs(16, halo=0):
            numbers = distinct(np.append(numbers, distinct(slab.samples)))
        table = {label.number: label for label in volume.labels or ()}
        found = [int(number) for number in numbers[np.isfinite(numbers)] if number]
        segments += [(layer, table.get(number, Label(number))) for number in found]
    if not 1 <= len(segments) <= MOST_SEGMENTS:
        raise expected("segments", f"1 to {MOST_SEGMENTS} in a DICOM segmentation", len(segments))
    return sorted(segments, key=lambda segment: (segment[1].number, segment[0]))


def _number_segments(layers: list[Volume], segments: list[tuple[int, Label]]) -> np.ndarray:
    """Numbers [D, H, W] of segments from 1 on; of several layers masks [D, H, W, segment]."""
    shape, dtype = layers[0].shape, np.dtype(np.uint8 if len(segments) < 256 else np.uint16)
    shape_of_all = (*shape, len(segments)) if len(layers) > 1 else shape
    require_memory(2 * byte_count(shape_of_all, dtype), byte_count(shape, dtype), what="segments")
    array = np.zeros(shape_of_all, dtype)
    numbers = np.array([0, *(label.number for _, label in segments)])
    for layer, volume in enumerate(layers):
        for slab in volume.slabs(16, halo=0):
            planes = array[slab.start : slab.stop]
            if len(layers) == 1:
                known = np.isfinite(slab.samples)
                ranks = np.searchsorted(numbers, slab.samples[known], sorter=(order := np.argsort(numbers)))
                planes[known] = order[ranks]
                continue
            for n, (owner, label) in enumerate(segments):
                if owner == layer:
                    planes[..., n] = slab.samples == label.number
    return array


def _read_images(path: Path) -> list[Any]:
    """Headers of the images of the largest series of a path, complete as highdicom asks for."""
    series = find_series(path).series
    if not series:
        raise expected(path, "a series of DICOM images", "segments")
    frames, _ = largest_group(select_series(series, LoadOptions()).frames)
    images: list[Any] = []
    for source in dict.fromkeys(frame.header.source for frame in frames):
        with source.open() as file:
            images.append(_complete(read_dataset(file), images[0] if images else None))
    return images


def _stand_in(volume: Volume) -> Any:
    """The header of an image that stands for those that the labels were drawn on."""
    from pydicom.dataset import Dataset

    image = Dataset()
    image.SOPClassUID, image.Modality = _CT, "CT"
    image.ImagePositionPatient, image.ImageOrientationPatient = list(volume.origin), [1, 0, 0, 0, 1, 0]
    image.PixelSpacing, image.SliceThickness = list(volume.spacing[1::-1]), volume.spacing[2]
    image.Rows, image.Columns = volume.shape[1:]
    return _complete(image, None)


def _complete(image: Any, first: Any) -> Any:
    """The image with empty texts and new identifiers where it has none; of its series those of the first."""
    from pydicom.uid import generate_uid

    for name in _TEXTS:
        if name not in image:
            setattr(image, name, "")
    for name in _UIDS:
        if not image.get(name):
            setattr(image, name, first.get(name) if first is not None and name != "SOPInstanceUID" else generate_uid())
    return image
