"""Pictures of several sources by one `splatgl render`: in this process, or each by a worker."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from splatgl.animation.movie import expanded
from splatgl.annotations.canvas import Canvas
from splatgl.cli.options import name_of, require_sources
from splatgl.cli.output import OutputOptions
from splatgl.cli.parser import BAD_INPUT, one_line
from splatgl.data.figure import VECTOR
from splatgl.data.image import SAVED, Image
from splatgl.errors import USER_ERRORS, InputError, error_text, expected
from splatgl.fileio import budget, check_output, format_bytes, write_file
from splatgl.scene.draw import DrawOptions, WorkerOptions, draw, progress_bar
from splatgl.scene.open_scene import OpenScene, look_notes, print_lines, series_look

if TYPE_CHECKING:
    from splatgl.data.affine import World
    from splatgl.distributed.workers import Drawing
    from splatgl.geometry.camera import Camera
    from splatgl.scene.scene_file import SceneFile


# of a pixel in memory
BYTES = 16


@dataclass(frozen=True)
class SharedView:
    """The camera that all pictures share, its frame and unit, and the length of their opacities; None of points."""

    camera: Camera
    world: World
    length: float | None

    @classmethod
    def of(cls, scene: OpenScene) -> SharedView:
        """The view and length of the first picture."""
        length = None if scene.volume.points is not None else scene.transfer.length(scene.volume)
        return cls(scene.camera, scene.volume.world, length)

    def read(self, file: SceneFile, is_quiet: bool) -> OpenScene:
        """Reads a scene with these. Notes on a window are of the first picture."""
        file = replace(file, view=replace(file.view, fixed=self.camera), world=self.world)
        if self.length is not None:
            file = file.with_transfer({"unit": self.length})
        plain = {name: value for name, value in file.transfer.items() if name != "window"}
        volume = OpenScene.read(replace(file, transfer=plain), is_quiet).volume
        return OpenScene.of(file, volume, is_quiet)


@dataclass(frozen=True)
class BatchJob:
    """A picture to draw. file: the scene, or its error. same: what an earlier picture shares with it."""

    output: OutputOptions
    file: SceneFile | str
    same: SharedView | None = None


@dataclass(frozen=True)
class BatchPicture:
    """A picture that is written. text: to print of it. same: None unless it is asked for."""

    data: bytes
    text: str
    same: SharedView | None


Results = Iterator[tuple[BatchJob, BatchPicture | str]]


def run_batch(
    sources: Sequence[str],
    scene_of: Callable[[str], SceneFile],
    output: OutputOptions,
    how: DrawOptions,
    by: WorkerOptions,
) -> int:
    """Draws a picture of each source; an error of one is printed, and the others are drawn. Returns 0, or BAD_INPUT if
    one failed.
    """
    jobs = [BatchJob(each, _scene(scene_of, each.source)) for each in outputs_of(sources, output)]
    if output.same:
        files = [job.file for job in jobs if not isinstance(job.file, str)]
        look = series_look(files)
        print_lines(look_notes(look, files), output.is_quiet)
        jobs = [job if isinstance(job.file, str) else replace(job, file=replace(job.file, look=look)) for job in jobs]
    failed, written = 0, list[Path]()
    for job, drawn in _on_workers(jobs, how, by) if by.are_used else _here(jobs, how):
        if isinstance(drawn, BatchPicture):
            try:
                write_file(job.output.path, drawn.data)
                written.append(job.output.path)
            except InputError as error:
                drawn = error_text(error)
        if isinstance(drawn, str):
            failed += 1
            _tell_error(job.output, drawn)
        elif drawn.text:
            print(drawn.text, flush=True)
    if output.sheet is not None and written:
        write_file(Path(output.sheet), picture_sheet(sorted(written)).encoded(Path(output.sheet)))
    if not output.is_quiet or failed:
        text = f"{len(jobs) - failed} of {len(jobs)} pictures drawn" + (f", {failed} failed" if failed else "")
        print(text, file=sys.stderr if failed or output.json else sys.stdout)
    return BAD_INPUT if failed else 0


def picture_sheet(files: Sequence[Path]) -> Image:
    """One picture of several, in rows of about as many as there are rows, each below the name of its file."""
    pictures = [Image.load(file).pixels for file in files]
    canvas = Canvas.over(pictures[0], None)
    high, wide = (max(picture.shape[axis] for picture in pictures) for axis in (0, 1))
    line, columns = canvas.text_size("")[1], math.ceil(math.sqrt(len(files)))
    size = (-(-len(files) // columns) * (high + line), columns * wide)
    needed = 2 * size[0] * size[1] * BYTES
    if needed > budget():
        raise expected("--sheet", f"pictures of at most {format_bytes(budget())} together", format_bytes(needed))
    sheet = np.empty((*size, 4), np.float32)
    sheet[:] = pictures[0][0, 0]
    text = Canvas(np.zeros_like(sheet), canvas.ink, font=canvas.em)
    for number, (file, picture) in enumerate(zip(files, pictures, strict=True)):
        row, column = divmod(number, columns)
        left, top = column * wide, row * (high + line)
        text.text(file.stem, left, top)
        sheet[top + line : top + line + picture.shape[0], left : left + picture.shape[1]] = picture
    return Image(text.pixels + (1 - text.pixels[..., 3:]) * sheet, {})


def outputs_of(named: Sequence[str], output: OutputOptions) -> list[OutputOptions]:
    """The output of each picture. Raises InputError, before any work, for names of outputs that are equal, or that
    cannot be written. named: sources and patterns.
    """
    for flag, value in {"--depth": output.depth, "--ref": output.ref}.items():
        if value is not None:
            raise expected(flag, "one source", "several", "leave it out")
    if output.sheet is not None:
        check_output(Path(output.sheet), SAVED)
    sources, template = expanded(named), output.output or "{name}.png"
    outputs = [replace(output, source=source, output=_output(template, source, n)) for n, source in enumerate(sources)]
    if len(sources) > 1 and "{" not in template:
        require_sources(sources)
        raise expected("-o", "a name for each source, such as 'out/{name}.png'", template)
    first: dict[Path, str] = {}
    for each in outputs:
        other = first.setdefault(each.path.absolute(), each.source)
        if other is not each.source:
            got, fix = f"{each.output} for {other} and {each.source}", "use {folder} or {number} to make names unique"
            raise expected("-o", "a file for each source", got, fix)
    for each in outputs:
        each.check(sources)
        if output.sheet is not None and each.path.suffix.lower() in VECTOR:
            raise expected("--sheet", "pictures in pixels", each.path.suffix, "name .png files with -o")
        if output.sheet is not None and each.path.absolute() == Path(output.sheet).absolute():
            raise expected("--sheet", "another file than -o", output.sheet)
    return outputs


def _scene(scene_of: Callable[[str], SceneFile], source: str) -> SceneFile | str:
    try:
        return scene_of(source)
    except USER_ERRORS as error:
        return error_text(error)


def _output(template: str, source: str, number: int) -> str:
    """The output of a source. Raises InputError for other fields than name, folder and number."""
    try:
        folder = Path(source).absolute().parent.name
        return template.format(name=name_of(source), folder=folder, number=number)
    except (KeyError, ValueError, IndexError, AttributeError):
        raise expected("-o", "a name with {name}, {folder} or {number}", template) from None


def _tell_error(output: OutputOptions, message: str) -> None:
    line, source = one_line(message), output.source
    if output.json:
        print(json.dumps({"source": source, "output": output.output, "error": line}, ensure_ascii=False), flush=True)
    else:
        # errors of reading begin with the source
        print(f"splatgl: {line if line.startswith(source) else f'{source}: {line}'}", file=sys.stderr)


def _here(jobs: Sequence[BatchJob], how: DrawOptions) -> Results:
    """Yields each job with its picture or its error, drawn in this process."""
    same: SharedView | None = None
    with how.renderer() as renderer:
        for job in jobs:
            drawn = draw_job(replace(job, same=same), replace(how, held=renderer))
            same = same or (drawn.same if isinstance(drawn, BatchPicture) else None)
            yield job, drawn


def _on_workers(jobs: Sequence[BatchJob], how: DrawOptions, by: WorkerOptions) -> Results:
    """Yields each job with its picture or its error, drawn by workers; with --same those up to the first picture are
    drawn in this process.
    """
    from splatgl.distributed.workers import spread
    from splatgl.splat.kernels import require_built_in

    how.check_supported("workers", "pictures rendered by this process", "--workers")
    for job in jobs:
        require_built_in("auto" if isinstance(job.file, str) else job.file.settings.kernel)
    same, rest, is_quiet = None, list(jobs), jobs[0].output.is_quiet
    while jobs[0].output.same and rest and same is None:
        (result,) = _here([rest.pop(0)], how)
        same = result[1].same if isinstance(result[1], BatchPicture) else None
        yield result
    # a scheduler may be elsewhere
    moved = [job if isinstance(job.file, str) else replace(job, file=job.file.with_absolute_paths()) for job in rest]
    left = {str(number): replace(job, same=same) for number, job in enumerate(moved if by.scheduler else rest)}
    with by.connected(None if is_quiet else print) as client, progress_bar("picture", is_quiet) as progress:
        items = [(key, (job, how, by.drawing)) for key, job in left.items()]
        try:
            for done, (key, drawn) in enumerate(spread(client, _draw_on_worker, items), 1):
                progress(done, len(rest))
                yield left.pop(key), drawn
        except InputError as error:
            # workers died of the pictures that are left
            for job in left.values():
                yield job, error_text(error)


def _draw_on_worker(job: BatchJob, how: DrawOptions, drawing: Drawing) -> BatchPicture | str:
    from splatgl.distributed.workers import renderer

    return draw_job(job, replace(how, held=renderer(drawing)))


def draw_job(job: BatchJob, how: DrawOptions) -> BatchPicture | str:
    """The picture of a job, or its error."""
    file, output, same = job.file, job.output, job.same
    if isinstance(file, str):
        return file
    try:
        scene = OpenScene.read(file, output.is_quiet) if same is None else same.read(file, output.is_quiet)
        image = draw(scene, how).with_accuracy()
        shared = SharedView.of(scene) if output.same and same is None else None
        return BatchPicture(image.encoded(output.path, output.bits), output.report(image, scene), shared)
    except USER_ERRORS as error:
        return error_text(error)
