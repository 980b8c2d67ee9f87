"""Labels in a volume that would hide them: it is drawn faintly, in every front end, unless options state opacities."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl.cli.main import main
from splatgl.scene.open_scene import OpenScene
from splatgl.scene.scene_file import SceneFile
from splatgl.scene.transfer_choice import FAINTLY
from splatgl.scene.view import ViewOptions
from splatgl.viewer.document import Document
from splatgl.viewer.jobs import Jobs
from splatgl.viewer.loading import AddedFiles, Files
from splatgl.viewer.saving import scene_of
from splatgl.viewer.state import History, State

pytestmark = pytest.mark.usefixtures("shared_programs")

SIZE = (48, 48)


def body(size: int = 32) -> sg.Volume:
    """A ball of tissue in air, of noise, as scanners give it."""
    z, y, x = np.indices((size,) * 3) - (size - 1) / 2
    noise = np.random.default_rng(1).normal(0, 8, (size,) * 3)
    return sg.Volume(
        (np.where(x * x + y * y + z * z < (0.45 * size) ** 2, 500, 0) + noise).astype(np.int16), name="body"
    )


def labels_in(size: int = 32) -> np.ndarray:
    found = np.zeros((size,) * 3, np.uint8)
    found[12:20, 12:20, 8:14], found[12:20, 12:20, 18:24] = 1, 2
    return found


def seen(with_labels: np.ndarray, without: np.ndarray) -> float:
    """The largest change of colour by labels."""
    return float(np.abs(with_labels - without)[..., :3].max())


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("labels")
    body().save(place / "body.nrrd")
    sg.Volume(labels_in(), labels=()).save(place / "seg.nrrd")
    return place


def test_labels_are_seen_through_a_volume(renderer: sg.Renderer) -> None:
    """At any size, on any grid, for any unit of opacities."""
    for size, options in ((32, {}), (64, {}), (32, {"spacing": (0.5, 0.5, 2.0)}), (32, {"unit": 3.0})):
        volume = replace(body(size), spacing=options.pop("spacing", (1.0, 1.0, 1.0)))  # type: ignore[arg-type]
        scale = size // 32
        labels = labels_in().repeat(scale, 0).repeat(scale, 1).repeat(scale, 2)
        scene = SceneFile("body", held=volume, view=ViewOptions(SIZE, zoom=1.3), transfer=options)
        drawn = OpenScene.read(scene.with_options(labels=labels, background="transparent"))
        picture = renderer.render(drawn.subject, drawn.camera, drawn.settings).pixels
        hidden = sg.Scene(drawn.scene.layers[:1])
        without = renderer.render(hidden, drawn.camera, drawn.settings).pixels
        assert seen(picture, without) > 0.2
        # the volume is seen, too
        assert 0.1 < float(np.median(without[..., 3][without[..., 3] > 0.02])) < 0.8
        assert FAINTLY in drawn.volume.notes


def test_the_window_shows_the_labels_of_render(folder: Path, renderer: sg.Renderer) -> None:
    """By an opacity in the list of layers, which a saved scene has; a labels file that is dropped is seen, too."""
    scene = SceneFile(str(folder / "body.nrrd"), view=ViewOptions(SIZE)).with_options(labels=str(folder / "seg.nrrd"))
    opened = OpenScene.read(scene)
    right = renderer.render(opened.subject, opened.camera, opened.settings, verify_bound=False).pixels
    document = Document.open(scene, quiet=True)
    state = State.of(document, SIZE)

    def picture(document: Document) -> np.ndarray:
        subject, settings = document.subject_at(1, state.settings)
        return renderer.render(subject, opened.camera, settings, verify_bound=False).pixels

    assert np.array_equal(picture(document), right) and document.styles[0].opacity < 0.1
    again = replace(scene_of(state, document), view=ViewOptions(SIZE, fixed=opened.camera))
    saved = OpenScene.read(SceneFile.from_toml(written(again, folder / "again.toml")))
    drawn = renderer.render(saved.subject, opened.camera, saved.settings, verify_bound=False).pixels
    assert np.array_equal(drawn, right)
    # dropped on the volume alone: undo takes both back
    document = Document.open(replace(scene, layers=()), quiet=True)
    state = State.of(document, SIZE)
    for edited in (state, state.edit(extinction=0.5)):
        history, (later, shown) = History(edited), added(document, edited, folder / "seg.nrrd")
        shown = shown.with_styles(later.styles, (), later.settings)
        assert np.array_equal(picture(shown), right) == (edited is state)
        history.note(later)
        assert history.undo(later).styles == edited.styles


def written(scene: SceneFile, path: Path) -> Path:
    path.write_text(replace(scene, view=ViewOptions(SIZE)).to_toml(path.parent))
    return path


def added(document: Document, state: State, path: Path) -> tuple[State, Document]:
    files = Files(Jobs(lambda: None), (), None, 0.0)
    files.add([str(path)], document.scene)
    assert files.jobs.wait(60)
    (done,) = files.jobs.collect()
    assert isinstance(done.value, AddedFiles)
    return done.value.added_to(state, document)


@pytest.mark.parametrize(
    "options",
    [
        {"points": [(0, 0), (500, 0.9)]},
        {"preset": "mri"},
        {"curve": "band:50%,90%"},
        {"blend": "mip"},
        {"iso": [250]},
        {"threshold": 0.05},
    ],
)
def test_what_options_state_stays(options: dict[str, Any]) -> None:
    scene = SceneFile("body", held=body()).with_options(**options)
    both = scene.with_options(labels=labels_in())
    volume = scene.open()
    assert both.transfer_for(volume) == scene.transfer_for(volume) and FAINTLY not in both.open().notes


def test_other_pictures_stay() -> None:
    """Hidden labels, a segmentation under labels, several channels and slices."""
    scene = SceneFile("body", held=body())
    both = scene.with_options(labels=labels_in())
    hidden = replace(both, layers=(replace(both.layers[0], visible=False),))
    volume = body()
    assert hidden.transfer_for(volume) == scene.transfer_for(volume) != both.transfer_for(volume)
    segments = SceneFile("seg", held=sg.Volume(labels_in(), labels=()))
    assert segments.with_options(labels=labels_in()).transfer_for(segments.open()) == segments.transfer_for(
        segments.open()
    )
    two = replace(volume, channels=(volume, volume))
    assert both.transfer_for(two) == scene.transfer_for(two)
    # a slice shows values as they are, whatever their opacity
    cut = {"size": 64, "slices": ["z=4"], "labels": labels_in()}
    assert np.array_equal(sg.render(volume, **cut).pixels, sg.render(volume, scene.transfer_for(volume), **cut).pixels)


def test_the_command_says_so(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = [
        "render",
        str(folder / "body.nrrd"),
        "--labels",
        str(folder / "seg.nrrd"),
        "--size",
        "32",
        "--check",
        "0",
    ]
    assert main([*command, "-o", str(folder / "p.png")]) == 0
    assert FAINTLY in capsys.readouterr().err
