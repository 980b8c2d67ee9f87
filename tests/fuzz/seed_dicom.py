"""Seed files of readers.py in DICOM: slices, folders and zips of them, multi-frame files, and compressed ones."""

from __future__ import annotations

import io
import struct
import zipfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from tests.fuzz.seed_files import CUBE, Seed

Written = Callable[[str, Callable[[Path], object]], Seed]

CT = "1.2.840.10008.5.1.4.1.1.2"
CODECS = {"rle": "1.2.840.10008.1.2.5", "j2k": "1.2.840.10008.1.2.4.90"}
JPEG = {"jpeg": "1.2.840.10008.1.2.4.50", "lossless": "1.2.840.10008.1.2.4.70", "ls": "1.2.840.10008.1.2.4.80"}


def image(array: np.ndarray, place: float = 0.0, **tags: object) -> Any:
    """A data set of an image [H, W], of frames [D, H, W], or of colours [H, W, 3], with pixels as they are."""
    from pydicom.dataset import Dataset, FileMetaDataset
    from pydicom.uid import ExplicitVRLittleEndian

    data = Dataset()
    data.file_meta = FileMetaDataset()
    data.file_meta.TransferSyntaxUID = ExplicitVRLittleEndian
    color = array.ndim == 3 and array.shape[-1] == 3
    data.SOPClassUID, data.SOPInstanceUID, data.SeriesInstanceUID = CT, f"1.2.3.{int(place * 8) + 1}", "1.2.3"
    data.Modality, data.SeriesNumber, data.InstanceNumber = "CT", 2, int(place) + 1
    data.ImagePositionPatient, data.ImageOrientationPatient = [1.0, 2.0, place], [1, 0, 0, 0, 1, 0]
    data.PixelSpacing, data.SliceThickness = [2.0, 1.5], 3.0
    data.Rows, data.Columns = array.shape[:2] if color else array.shape[-2:]
    if array.ndim == 3 and not color:
        data.NumberOfFrames = len(array)
    data.SamplesPerPixel, data.PhotometricInterpretation = (3, "RGB") if color else (1, "MONOCHROME2")
    if color:
        data.PlanarConfiguration = 0
    bits = array.dtype.itemsize * 8
    data.BitsAllocated, data.BitsStored, data.HighBit = bits, bits, bits - 1
    data.PixelRepresentation = int(array.dtype.kind == "i")
    data.RescaleSlope, data.RescaleIntercept = 1, 0
    data.PixelData = array.astype(array.dtype.newbyteorder("<")).tobytes()
    data["PixelData"].VR = "OB" if bits == 8 else "OW"
    for name, value in tags.items():
        setattr(data, name, value)
    return data


def enhanced(array: np.ndarray, step: float = 3.0) -> Any:
    """Frames with a place of their own each, in functional groups."""
    from pydicom.dataset import Dataset

    def item(**tags: object) -> Any:
        found = Dataset()
        for name, value in tags.items():
            setattr(found, name, value)
        return found

    data = image(array)
    for name in ("ImagePositionPatient", "ImageOrientationPatient", "PixelSpacing", "SliceThickness"):
        delattr(data, name)
    for name in ("RescaleSlope", "RescaleIntercept"):
        delattr(data, name)
    scale = item(RescaleSlope=2, RescaleIntercept=-7, RescaleType="HU")
    measures = item(PixelSpacing=[2.0, 1.5], SliceThickness=3.0)
    shared = item(
        PixelMeasuresSequence=[measures],
        PlaneOrientationSequence=[item(ImageOrientationPatient=[1, 0, 0, 0, 1, 0])],
        PixelValueTransformationSequence=[scale],
    )
    data.SharedFunctionalGroupsSequence = [shared]
    places = ([1.0, 2.0, step * n] for n in range(len(array)))
    data.PerFrameFunctionalGroupsSequence = [
        item(PlanePositionSequence=[item(ImagePositionPatient=place)]) for place in places
    ]
    return data


def film(array: np.ndarray) -> Any:
    """Frames that are moments, of ultrasound."""
    from pydicom.dataset import Dataset

    data = image(array, Modality="US", SOPClassUID="1.2.840.10008.5.1.4.1.1.3.1", FrameTimeVector=[40] * len(array))
    del data.ImagePositionPatient, data.ImageOrientationPatient, data.PixelSpacing
    region = Dataset()
    region.PhysicalUnitsXDirection = region.PhysicalUnitsYDirection = 3
    region.PhysicalDeltaX = region.PhysicalDeltaY = 0.02
    data.SequenceOfUltrasoundRegions = [region]
    return data


def parametric_stacks(array: np.ndarray) -> Any:
    """Two stacks of a parametric map."""
    from pydicom.dataset import Dataset

    data = enhanced(array)
    data.SOPClassUID = "1.2.840.10008.5.1.4.1.1.30"
    mapping = Dataset()
    mapping.RealWorldValueSlope, mapping.RealWorldValueIntercept = 0.5, -3.0
    data.SharedFunctionalGroupsSequence[0].RealWorldValueMappingSequence = [mapping]
    for n, group in enumerate(data.PerFrameFunctionalGroupsSequence):
        content = Dataset()
        content.StackID, content.FrameReferenceDateTime = str(2 * n // len(array)), f"202402292359{n:02}.5"
        group.FrameContentSequence = [content]
    return data


def csa(version: int = 2, length: int = 1, padding: int = 3, **entries: tuple[object, ...]) -> bytes:
    """A CSA header of Siemens of numbers and texts. Descriptions of version 1 differ in the number of an item that
    states its length, 0 or 1, and in whether up to 3 or 4 bytes are behind it.
    """
    data = (b"SV10\4\3\2\1" if version == 2 else b"") + struct.pack("<II", len(entries), 77)
    for name, values in entries.items():
        kind = {str: b"SH", int: b"US"}.get(type(values[0]), b"FD")
        texts = [f"{value}\0".encode() for value in values] + [b""] * (6 - len(values))
        data += struct.pack("<64si4siii", name.encode(), len(values), kind, 4, 6, 77)
        for text in texts:
            filled = -len(text) % 4 if padding == 3 else 4 - len(text) % 4
            words = [len(text), len(text)] if length else [len(text) + 6, 0]
            data += struct.pack("<4i", *words, 77, 0) + text + bytes(filled)
    return data


def mosaic_image(slices: np.ndarray, stated: dict[str, Any], **tags: object) -> Any:
    """Slices [N, H, W] side by side, as Siemens stores them. stated: "csa", "count" or "matrix", private elements."""
    count, rows, columns = slices.shape
    side = int(np.ceil(np.sqrt(count)))
    tiles = np.zeros((side * side, rows, columns), slices.dtype)
    tiles[:count] = slices
    whole = tiles.reshape(side, side, rows, columns).transpose(0, 2, 1, 3).reshape(side * rows, side * columns)
    data = image(whole, Modality="MR", ImageType=["ORIGINAL", "PRIMARY", "M", "ND", "MOSAIC"], **tags)
    for name, group, element, kind in (
        ("csa", 0x29, 0x10, "OB"),
        ("count", 0x19, 0xA, "US"),
        ("matrix", 0x51, 0xB, "LO"),
    ):
        if name in stated:
            creator = "SIEMENS CSA HEADER" if name == "csa" else "SIEMENS MR HEADER"
            data.private_block(group, creator, create=True).add_new(element, kind, stated[name])
    return data


def packed_image(array: np.ndarray, codec: str, **tags: object) -> Any:
    """The same, compressed: by pydicom's own encoders, Pillow, or imagecodecs, whichever has the codec."""
    if codec in CODECS:
        data = image(array, **tags)
        data.compress(CODECS[codec], generate_instance_uid=False)
        return data
    from pydicom.encaps import encapsulate
    from pydicom.uid import UID

    data = image(array, **tags)
    frames = array if "NumberOfFrames" in data else array[None]
    data.PixelData = encapsulate([_jpeg(frame, codec) for frame in frames])
    data["PixelData"].VR = "OB"
    data.file_meta.TransferSyntaxUID = UID(JPEG[codec])
    return data


def _jpeg(frame: np.ndarray, codec: str) -> bytes:
    if codec == "jpeg":
        from PIL import Image

        out = io.BytesIO()
        Image.fromarray(frame).save(out, "JPEG", quality=95)
        return out.getvalue()
    import imagecodecs

    return bytes(imagecodecs.ljpeg_encode(frame) if codec == "lossless" else imagecodecs.jpegls_encode(frame))


def save(data: Any, path: Path) -> None:
    data.save_as(path, enforce_file_format=True)


def series(folder: Path, count: int = 5, step: float = 3.0) -> None:
    """A folder of slices of CUBE, and another in it."""
    folder.mkdir(parents=True, exist_ok=True)
    for n in range(count):
        save(image(CUBE[n].astype(np.int16) - 100, n * step), folder / f"{(n * 3) % 5}.dcm")
    (folder / "more").mkdir()
    save(image(CUBE[0], 0, SeriesInstanceUID="1.2.4"), folder / "more" / "IM1")


def zipped(path: Path) -> None:
    import tempfile

    with tempfile.TemporaryDirectory() as folder, zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        series(Path(folder) / "a")
        for file in sorted(Path(folder).rglob("*")):
            if file.is_file():
                archive.write(file, file.relative_to(folder).as_posix())


def dicom_seeds(packed: bool, written: Written) -> list[Seed]:
    """Seeds of plain files, folders and zips, or of compressed ones."""
    wide = CUBE.astype(np.uint16) * 300
    # of small pictures OpenJPEG makes none
    large = np.kron(wide[:2], np.ones((1, 4, 4), np.uint16))
    if packed:
        pictures = [packed_image(wide, "rle"), packed_image(CUBE[0], "jpeg"), packed_image(large, "j2k")]
        pictures += [packed_image(wide[0], codec) for codec in ("lossless", "ls")]
        return [written("a.dcm", partial(save, data)) for data in pictures]
    rgb = np.repeat(CUBE[0][..., None], 3, axis=-1)
    padded = image(CUBE[0].astype(np.int16), PixelPaddingValue=5, RescaleSlope="0.5")
    plain = [image(CUBE[0].astype(np.int16)), enhanced(wide), image(CUBE), image(rgb), padded]
    header = csa(NumberOfImagesInMosaic=(len(CUBE),), SliceNormalVector=(0.0, 0.0, -1.0))
    first = csa(1, NumberOfImagesInMosaic=(len(CUBE),), SliceNormalVector=(0.0, 0.0, 1.0))
    plain += [mosaic_image(CUBE, {"csa": header}), mosaic_image(CUBE, {"csa": first})]
    plain += [mosaic_image(CUBE, {"count": len(CUBE), "matrix": "9*11"})]
    plain += [film(CUBE), parametric_stacks(CUBE)]
    files = [written("a.dcm", partial(save, data)) for data in plain]
    return [*files, written("a", series), written("a", series), written("a.zip", zipped)]
