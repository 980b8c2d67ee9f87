"""Names of annotations, whether those asked for are known, and laying them over; draws nothing until then."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from splatgl.annotations.annotate import ROOM, check, check_size, check_time, parsed
from splatgl.errors import expected
from splatgl.splat.settings import BLENDS

if TYPE_CHECKING:
    from splatgl.app.scene import Scene
    from splatgl.data.image import Image
    from splatgl.data.volume import Volume
    from splatgl.splat.clipping import Part
    from splatgl.splat.settings import Settings
    from splatgl.splat.transfer import Transfer


def asked_for(text: str | None, reference: str | None, scene: Scene) -> tuple[str, ...]:
    """The annotations of a command's picture, else of its scene, but in comparisons; InputError for what can't be laid
    over it, before anything is drawn.
    """
    if text is None:
        asked = () if reference is not None else check(scene.annotate)
    else:
        asked = parsed(text)
        if reference is not None:
            raise expected("annotate", "no --ref, which compares pictures without annotations", reference)
    check_size(asked, scene.view.size)
    check_time(asked)
    return asked


def of_movie(text: str | None, scenes: Sequence[Scene]) -> tuple[str, ...]:
    """The annotations of a movie, else of its scene: time stands for that of each volume of a series. InputError as
    `check`, and for a time of one volume.
    """
    asked = check(scenes[0].annotate) if text is None else parsed(text)
    check_size(asked, scenes[0].view.size)
    if len(scenes) == 1:
        check_time(asked)
    return asked


def at_time(asked: Sequence[str], scene: Scene, number: int, step: float | None) -> tuple[str, ...]:
    """The annotations of a frame that shows volume `number` of a series. step: seconds between two time points."""
    point = int(scene.load.get("time", number))
    told = f"{point * step:g} s" if step else f"{point}"
    return tuple(f"time={told}" if one == "time" else one for one in asked)


def unbacked(settings: Settings, asked: Sequence[str]) -> Settings:
    """The settings of a picture under annotations: with a box it is drawn without its background, so that edges behind
    the box come between both. Sums have none.
    """
    return settings.but(background=None) if "box" in asked and not BLENDS[settings.blend].unbounded else settings


def with_room(scene: Scene, volume: Volume, asked: Sequence[str]) -> Scene:
    """The scene, with a view that shows the box and its numbers, where they are asked for."""
    if "box" not in asked:
        return scene
    from splatgl.app.viewpoint import Fitted

    return replace(scene, view=Fitted.of(scene.view, room(volume)))


def room(volume: Volume) -> Part:
    """What a view is fitted to that shows a volume's box and its numbers."""
    from splatgl.splat.clipping import Part

    return Part(volume.center + (volume.corners - volume.center) * ROOM, volume.frame)


def lay(
    image: Image, scene: Scene, volume: Volume, transfer: Transfer, asked: Sequence[str], quiet: bool = False
) -> Image:
    """The picture of a scene under annotations, by the camera that it was drawn with; prints why some are left out."""
    from splatgl.annotations.annotate import annotated, left_out, on_ground
    from splatgl.annotations.canvas import Scale, Subject
    from splatgl.app.depths import camera_of
    from splatgl.app.layered import is_layered, layered
    from splatgl.app.meshes import is_mesh

    told, drawn = Subject.of(volume), None
    if is_layered(scene, volume):
        drawn = layered(scene, volume, transfer)
        told = replace(told, scales=Scale.of(drawn.meshes), empty=is_mesh(scene.volume))
    camera = camera_of(scene, volume, transfer, drawn)
    found = annotated(image, told, transfer, camera, asked, scene.settings.background)
    found = on_ground(found, None if BLENDS[scene.settings.blend].unbounded else scene.settings.background)
    for note in () if quiet else left_out(found):
        print(f"splatgl: {note}", file=sys.stderr)
    return found
