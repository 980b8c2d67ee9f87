"""Pictures of several sources by one `splatgl render`: in this process, or each by a worker."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from splatgl.animation.movie import expanded
from splatgl.cli.options import name_of, record_of, require_sources, scene_from
from splatgl.cli.output import check_outputs, report
from splatgl.cli.parser import BAD_INPUT, one_line
from splatgl.errors import USER_ERRORS, InputError, error_text, expected
from splatgl.fileio import write_file
from splatgl.scene.draw import DrawOptions, WorkerOptions, draw, print_lines, progress_bar
from splatgl.scene.open_scene import OpenScene, look_notes, series_look

if TYPE_CHECKING:
    from splatgl.data.affine import World
    from splatgl.distributed.worker import Drawing
    from splatgl.scene.scene_file import SceneFile
    from splatgl.scene.transfer_choice import SeriesLook
    from splatgl.splat.camera import Camera

# options of one picture, by their names in arguments
ALONE = {"depth": "--depth", "ref": "--ref"}


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
class BatchPicture:
    """A picture that is written. text: to print of it. same: None unless it is asked for."""

    data: bytes
    text: str
    same: SharedView | None


def run_batch(args: argparse.Namespace) -> int:
    """Draws a picture of each source; an error of one is printed, and the others are drawn. Returns 0, or BAD_INPUT if
    one failed.
    """
    by, jobs = record_of(args, WorkerOptions), jobs_of(args)
    look = _shared_look(jobs) if args.same else None
    for job in jobs:
        job.look = look
    failed = 0
    for job, drawn in _on_workers(args, jobs, by) if by.are_used else _here(args, jobs):
        if isinstance(drawn, BatchPicture):
            try:
                write_file(Path(job.output), drawn.data)
            except InputError as error:
                drawn = error_text(error)
        if isinstance(drawn, str):
            failed += 1
            _tell_error(job, drawn)
        elif drawn.text:
            print(drawn.text, flush=True)
    if not (args.quiet or args.json) or failed:
        text = f"{len(jobs) - failed} of {len(jobs)} pictures drawn" + (f", {failed} failed" if failed else "")
        print(text, file=sys.stderr if failed or args.json else sys.stdout)
    return BAD_INPUT if failed else 0


def jobs_of(args: argparse.Namespace) -> list[argparse.Namespace]:
    """The arguments of each picture. Raises InputError, before any work, for names of outputs that are equal, or that
    cannot be written.
    """
    for name, flag in ALONE.items():
        if getattr(args, name) is not None:
            raise expected(flag, "one source", "several", "leave it out")
    sources = expanded((args.source, *args.more))
    template = args.output or "{name}.png"
    outputs = [_output(template, source, number) for number, source in enumerate(sources)]
    if len(sources) > 1 and "{" not in template:
        require_sources(sources)
        raise expected("-o", "a name for each source, such as 'out/{name}.png'", template)
    first: dict[str, str] = {}
    for source, output in zip(sources, outputs, strict=True):
        other = first.setdefault(str(Path(output).absolute()), source)
        if other is not source:
            fix = "{folder} and {number} tell them apart"
            raise expected("-o", "a file for each source", f"{output} for {other} and {source}", fix)
    jobs = [
        argparse.Namespace(**{**vars(args), "source": source, "more": [], "output": output})
        for source, output in zip(sources, outputs, strict=True)
    ]
    for job in jobs:
        check_outputs(job, Path(job.output), sources)
    return jobs


def _shared_look(jobs: Sequence[argparse.Namespace]) -> SeriesLook | None:
    """The look that the pictures share; prints a note on it. Sources that cannot be read have their error later."""
    files: list[SceneFile] = []
    for job in jobs:
        with suppress(*USER_ERRORS):
            files.append(scene_from(job))
    look = series_look(files)
    print_lines(look_notes(look, files), jobs[0].quiet or jobs[0].json)
    return look


def _output(template: str, source: str, number: int) -> str:
    """The output of a source. Raises InputError for other fields than name, folder and number."""
    try:
        folder = Path(source).absolute().parent.name
        return template.format(name=name_of(source), folder=folder, number=number)
    except (KeyError, ValueError, IndexError, AttributeError):
        raise expected("-o", "a name with {name}, {folder} or {number}", template) from None


def _tell_error(job: argparse.Namespace, message: str) -> None:
    """Prints the error of one picture."""
    line = one_line(message)
    if job.json:
        print(json.dumps({"source": job.source, "output": job.output, "error": line}, ensure_ascii=False), flush=True)
    else:
        # errors of reading begin with the source
        text = line if line.startswith(job.source) else f"{job.source}: {line}"
        print(f"splatgl: {text}", file=sys.stderr)


def _here(args: argparse.Namespace, jobs: Sequence[argparse.Namespace]) -> Iterator[tuple[Any, BatchPicture | str]]:
    """Yields each job with its picture or its error, drawn in this process."""
    same: SharedView | None = None
    how = record_of(args, DrawOptions)
    with how.renderer() as renderer:
        for job in jobs:
            drawn = draw_job(job, replace(how, held=renderer), same)
            same = same or (drawn.same if isinstance(drawn, BatchPicture) else None)
            yield job, drawn


def _on_workers(
    args: argparse.Namespace, jobs: list[argparse.Namespace], by: WorkerOptions
) -> Iterator[tuple[Any, BatchPicture | str]]:
    """Yields each job with its picture or its error, drawn by workers; with --same those up to the first picture are
    drawn in this process.
    """
    from splatgl.distributed.cluster import spread
    from splatgl.splat.kernels import require_built_in

    require_built_in(args.kernel or "auto")
    record_of(args, DrawOptions).check_supported("workers", "pictures that are drawn by this process", "--workers")
    same: SharedView | None = None
    rest = list(jobs)
    while args.same and rest and same is None:
        (result,) = _here(args, [rest.pop(0)])
        same = result[1].same if isinstance(result[1], BatchPicture) else None
        yield result
    places = {str(number): job for number, job in enumerate(rest)}
    with by.connected(None if args.quiet or args.json else print) as client:
        items = [(key, (_plain(job), by.drawing, same)) for key, job in places.items()]
        with progress_bar("picture", args.quiet or args.json) as progress:
            try:
                for done, (key, drawn) in enumerate(spread(client, _draw_on_worker, items), 1):
                    progress(done, len(rest))
                    yield places.pop(key), drawn
            except InputError as error:
                # workers died of the pictures that are left
                for job in places.values():
                    yield job, error_text(error)


def _plain(job: argparse.Namespace) -> dict[str, Any]:
    """The arguments of a job for another process, where a scheduler may be elsewhere with an absolute path."""
    is_moved = job.scheduler is not None and Path(job.source).exists()
    return {**vars(job), "run": None, "source": str(Path(job.source).absolute()) if is_moved else job.source}


def _draw_on_worker(arguments: dict[str, Any], drawing: Drawing, same: SharedView | None) -> BatchPicture | str:
    """Draws a job on a worker, with its renderer."""
    from splatgl.distributed.worker import renderer

    job = argparse.Namespace(**arguments)
    return draw_job(job, replace(record_of(job, DrawOptions), held=renderer(drawing)), same)


def draw_job(job: argparse.Namespace, how: DrawOptions, same: SharedView | None) -> BatchPicture | str:
    """The picture of a job, or its error. same: what an earlier picture shares with it."""
    output, is_quiet = Path(job.output), job.quiet or job.json
    try:
        file = replace(scene_from(job), look=job.look)
        scene = OpenScene.read(file, is_quiet) if same is None else same.read(file, is_quiet)
        image = draw(scene, how).with_accuracy()
        data = image.encoded(output, job.bits)
        return BatchPicture(
            data, report(job, image, scene), SharedView.of(scene) if job.same and same is None else None
        )
    except USER_ERRORS as error:
        return error_text(error)
