"""Draws every method of a scene, measures each once and times them repeatedly, interleaved in random order."""

from __future__ import annotations

import random
import statistics
import time
from collections.abc import Callable, Hashable

from splatgl.data.image import Image
from splatgl.errors import InputError, expected
from splatgl.reference.renderer import Planner
from splatgl.splat.settings import Settings
from splatgl.truth.report.errors import errors
from splatgl.truth.report.methods import Method, axis_of, methods
from splatgl.truth.report.peers import Peer
from splatgl.truth.report.store import Store
from splatgl.truth.report.subject import Level, Subject
from splatgl.truth.report.truths import Truths

# seed of the random order, fixed for all runs
SEED = 1998
# after this total time in seconds a method is not timed again beyond the minimum number of rounds
LONGEST, LEAST_ROUNDS = 20.0, 3
# a turn has as many frames as fit into TURN seconds, at least one and at most FRAMES
TURN, FRAMES = 0.04, 5
# FLIP is measured against this truth
FLIP_TRUTH = "sampled"
# recorded properties of a rendering
DRAWN = ("align", "antialias", "footprint", "samples", "attenuation", "target")

# progress callback, called once per step
Tick = Callable[[str], None]


def chosen(level: Level, only: tuple[str, ...] = (), peers: bool = False) -> list[Method]:
    """The methods of a report at that level; only: names of methods or axes, all if empty; peers: VTK too."""
    known = [method for method in methods().values() if method.quick or level.all_methods or only]
    named = [m for m in known if not only or m.name in only or axis_of(m.name).name in only]
    return [m for m in known if (m.peer and peers) or (m in named and (not m.peer or only))]


class Sweep:
    """Records one scene's images and times in a store. flip: whether FLIP is measured."""

    def __init__(self, renderer: Planner, subject: Subject, truths: Truths, store: Store, flip: bool) -> None:
        self.renderer, self.subject, self.truths, self.store, self.flip = renderer, subject, truths, store, flip
        self.plans: dict[tuple[Hashable, int], str] = {}
        self.peers: dict[str, Peer] = {}

    def pictures(self, wanted: list[Method], tick: Tick) -> None:
        """Draws each method once, and measures it against every truth."""
        for method in wanted:
            tick(f"{self.subject.name}: {method.name}")
            done = self.store.of("picture", scene=self.subject.name, method=method.name)
            if done and not (done[0]["same_as"] or done[0]["omitted"] or method.peer):
                # already drawn: other methods may turn out to be identical
                splats, settings = self.subject.drawn(method)
                plan = self.renderer.plan(splats, self.subject.camera, settings)
                self.plans.setdefault((plan.key, id(splats)), method.name)
            if not done:
                line = self._peer_picture(method) if method.peer else self._picture(method)
                self.store.add("picture", scene=self.subject.name, **line)

    def _picture(self, method: Method) -> dict[str, object]:
        """The record of a method."""
        axis = axis_of(method.name).name
        line: dict[str, object] = {"axis": axis, "method": method.name, "same_as": "", "omitted": ""}
        try:
            splats, settings = self.subject.drawn(method)
            plan = self.renderer.plan(splats, self.subject.camera, settings)
        except InputError as error:
            return {**line, "omitted": str(error)}
        if not len(splats):
            return {**line, "omitted": "no splat is left"}

        # equal plans give equal images
        key = (plan.key, id(splats))
        if key in self.plans:
            line["same_as"] = self.plans[key]
        else:
            self.plans[key] = method.name
        image = self.renderer.render(splats, self.subject.camera, settings)
        return {
            **line,
            "splats": len(splats),
            "extraction": round(self.subject.seconds[id(splats)], 6),
            "tolerance": settings.tolerance,
            "bound": image.info["error_bound"],
            "drawn": {name: image.info[name] for name in DRAWN} | {"technique": plan.program.technique},
            **self._measured(image, settings, method),
        }

    def _peer_picture(self, method: Method) -> dict[str, object]:
        """The record of a method of a peer."""
        line: dict[str, object] = {
            "axis": axis_of(method.name).name,
            "method": method.name,
            "same_as": "",
            "omitted": "",
        }
        try:
            image = self._peer(method).frame()[0]
        except InputError as error:
            return {**line, "omitted": str(error)}
        return {**line, **self._measured(image, self.subject.settings, method)}

    def _peer(self, method: Method) -> Peer:
        if method.name not in self.peers:
            if self.subject.content is None:
                raise expected("peers", "a volume", "splats alone")
            settings = self.subject.settings.but(**method.changes)
            self.peers[method.name] = Peer(method.peer, self.subject.content, self.subject.camera, settings)
        return self.peers[method.name]

    def close(self) -> None:
        """Ends the peers' processes."""
        for peer in self.peers.values():
            peer.close()
        self.peers.clear()

    def _measured(self, image: Image, settings: Settings, method: Method) -> dict[str, object]:
        """The errors against each of the method's truths, or the reason why there are none.

        That the scene has no field is recorded with the scene.
        """
        found: dict[str, object] = {}
        missing: dict[str, str] = {}
        for truth in axis_of(method.name).measured:
            if truth == "field" and self.subject.no_field:
                continue
            # what is classified after reconstruction is no picture of splats
            if truth != "field" and image.info.get("classification") == "post":
                continue
            try:
                flip = self.flip and truth == FLIP_TRUTH
                found[truth] = errors(image, self.truths.get(truth, settings), flip).as_dict()
            except InputError as error:
                missing[truth] = str(error)
        return {"errors": found, "missing": missing}

    def times(self, wanted: list[Method], rounds: int, tick: Tick) -> None:
        """Times every method with a distinct image once per round, each round in another random order.

        Temporary load on the machine thus affects all methods alike, and they can be compared round by round.
        """
        named = {method.name: method for method in wanted}
        own = [
            line["method"]
            for line in self.store.of("picture", scene=self.subject.name, same_as="", omitted="")
            if line["method"] in named
        ]
        done = self.store.of("time", scene=self.subject.name)
        spent = {name: sum(line["seconds"] for line in done if line["method"] == name) for name in own}
        finished = {(line["method"], line["round"]) for line in done}
        shuffled = random.Random(SEED)
        for turn in range(rounds):
            for name in shuffled.sample(own, len(own)):
                tick(f"{self.subject.name}: timing")
                if (name, turn) in finished or (spent[name] > LONGEST and turn >= LEAST_ROUNDS):
                    continue
                seconds = self.turn(named[name])
                spent[name] += seconds
                self.store.add("time", scene=self.subject.name, method=name, round=turn, seconds=round(seconds, 6))

    def turn(self, method: Method) -> float:
        """Seconds per frame after a warm-up frame: the median of up to FRAMES that fit into TURN."""
        self.frame(method)
        first = self.frame(method)
        count = min(FRAMES, int(TURN / first))
        # an odd number, so that the median is a measured time
        return statistics.median([first, *(self.frame(method) for _ in range(2 * ((count - 1) // 2)))])

    def frame(self, method: Method) -> float:
        """Seconds for one finished frame, its pixels read back."""
        if method.peer:
            return self._peer(method).frame()[1]
        splats, settings = self.subject.drawn(method)
        started = time.perf_counter()
        self.renderer.render(splats, self.subject.camera, settings, verify_bound=False)
        return time.perf_counter() - started
