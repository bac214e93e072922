"""How long rendering takes and how much it fills: beforehand, and what is left while it goes on.

Beforehand some scenes of each family are probed: rendered at a few of their samples. What all of
them would take follows from what a path took, and from how many more there are.
"""

from __future__ import annotations

import json
import math
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from statistics import fmean, median, stdev
from typing import Any

import numpy as np

from cornerscenes.recipes import FilmRecipe
from cornerscenes.tasks import Setting, Task, scene_of

# Scenes of a family that are probed; the second and later ones only within this time [s].
PROBES_PER_FAMILY = 3
PROBING_S = 60.0

# How many samples a probe takes. Their noise says how many the scene needs about its corners.
FEW = {"periphery_samples": 8, "fovea_samples": 8, "corner_samples": 8}

# What one probe says of a family's scenes, as a share: until two of any family are known.
SPREAD = 0.5

# What the extrapolation may be wrong by, for all scenes alike, as a share of their cost. Measured
# by `python -m studies.estimates`.
EXTRAPOLATION = 0.2


@dataclass(frozen=True)
class Cost:
    """What a scene costs: a worker's time [s], size of its files [bytes]."""

    seconds: float
    bytes: float


@dataclass(frozen=True)
class Sum:
    """A sum over scenes with its uncertainty: 19 of 20 should lie between low and high."""

    expected: float
    low: float
    high: float

    def times(self, factor: float) -> Sum:
        """Return it multiplied."""
        return Sum(factor * self.expected, factor * self.low, factor * self.high)


@dataclass(frozen=True)
class FamilyCost:
    """What the scenes of one family are expected to cost.

    Attributes
    ----------
    family : str
        The family.
    scenes, probed : int
        How many are to be rendered, and from how many that were probed this is known.
    seconds, bytes : float
        The mean of a scene.
    """

    family: str
    scenes: int
    probed: int
    seconds: float
    bytes: float


def probes(tasks: Sequence[Task]) -> Iterator[Task]:
    """Yield a scene of each family, then others as long as there is time."""
    families: defaultdict[str, list[Task]] = defaultdict(list)
    for task in tasks:
        families[task.scene.family].append(task)
    few = [
        scenes[:: max(1, len(scenes) // PROBES_PER_FAMILY)][:PROBES_PER_FAMILY]
        for scenes in families.values()
    ]
    begun_s = time.monotonic()
    for number, scenes in enumerate(zip_longest(*few)):
        for task in scenes:
            in_time = number == 0 or time.monotonic() - begun_s < PROBING_S
            if task is not None and in_time:
                yield task


def probe(task: Task, setting: Setting) -> Cost:
    """Render a scene at a few of its samples, and tell from that what it costs."""
    from cornerscenes import scene_files

    started_s = time.monotonic()
    few = task.film.model_copy(update=FEW)
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        scene, world = scene_of(task, setting)
        scene_files.write(folder, scene, world, few, task.scene, task.key)
        seconds = time.monotonic() - started_s
        size_bytes = sum(file.stat().st_size for file in folder.iterdir())
        described, true = (
            json.loads((folder / name).read_text(encoding="utf-8"))
            for name in ("scene.json", "truth.json")
        )
    more = _paths(task.film, described, true) - sum(paths for paths, _ in world.traced)
    # Not the first time, which also waits for code to be compiled.
    path_s = median(seconds / paths for paths, seconds in world.traced[1:] or world.traced)
    return Cost(seconds + more * path_s, size_bytes)


def _paths(film: FilmRecipe, described: dict[str, Any], true: dict[str, Any]) -> int:
    """Return how many paths a film takes, from the scene.json and truth.json of a probe."""
    from cornerscenes.film import CORNER_RADIUS_PX, Window

    camera = described["camera"]
    pixels = Window(*described["film"]["fovea_px"]).pixels()
    samples = np.full(len(pixels), float(film.fovea_samples))
    for corner in true["corners"]:
        floor_px = corner["render_noise_floor_px"]
        if floor_px is not None:
            needed = FEW["fovea_samples"] * (floor_px / film.noise_floor_px) ** 2
            from_corner = np.linalg.norm(pixels - np.array(corner["image_point_px"]), axis=1)
            near = from_corner <= CORNER_RADIUS_PX
            samples[near] = np.maximum(samples[near], min(needed, film.corner_samples))
    in_box = film.oversampling**2 * samples.sum()
    return camera["width"] * camera["height"] * film.periphery_samples + int(in_box)


def estimate(
    tasks: Sequence[Task], probed: Mapping[str, Sequence[Cost]]
) -> tuple[list[FamilyCost], Sum, Sum]:
    """Return what scenes cost by family, and in sum: the time of one worker [s], and bytes.

    Parameters
    ----------
    tasks : Sequence[Task]
        What is to be rendered.
    probed : Mapping[str, Sequence[Cost]]
        What was found of each family; at least of one.
    """
    counts = Counter(task.scene.family for task in tasks)
    # A family of which nothing is known, because its probes failed, is taken to be like the others.
    any_family = [cost for costs in probed.values() for cost in costs]
    costs = {family: probed.get(family) or any_family for family in counts}
    families = [
        FamilyCost(
            family=family,
            scenes=count,
            probed=len(probed.get(family, ())),
            seconds=fmean(cost.seconds for cost in costs[family]),
            bytes=fmean(cost.bytes for cost in costs[family]),
        )
        for family, count in counts.items()
    ]
    seconds = {family: [cost.seconds for cost in known] for family, known in costs.items()}
    sizes = {family: [cost.bytes for cost in known] for family, known in costs.items()}
    return families, _sum(counts, seconds), _sum(counts, sizes)


def _sum(counts: Mapping[str, int], known: Mapping[str, Sequence[float]]) -> Sum:
    """Return the sum over families of as many scenes each, from what is known of some of them.

    The relative spread within a family is taken to be the same in all: few are known of each.
    """
    squares = [
        (len(values) - 1, (stdev(values) / fmean(values)) ** 2)
        for values in known.values()
        if len(values) > 1
    ]
    degrees = sum(weight for weight, _ in squares)
    spread = math.sqrt(sum(w * square for w, square in squares) / degrees) if degrees else SPREAD
    expected = sum(count * fmean(known[family]) for family, count in counts.items())
    variance = (EXTRAPOLATION * expected) ** 2 + sum(
        (spread * fmean(known[family])) ** 2 * (count**2 / len(known[family]) + count)
        for family, count in counts.items()
    )
    # As a factor, so that the low end stays above nothing.
    factor = math.exp(2.0 * math.sqrt(variance) / expected)
    return Sum(expected, expected / factor, expected * factor)


class Expectation:
    """The time that is left while tasks are done.

    A scene is expected to take as long as those of its family did, or of any family where none of
    its own is done yet.

    Parameters
    ----------
    tasks : Sequence[Task]
        All that is to be done.
    workers : int
        How many are done at a time.
    """

    def __init__(self, tasks: Sequence[Task], workers: int) -> None:
        self._waiting = {task.name: task.scene.family for task in tasks}
        self._running: dict[str, tuple[str, float]] = {}
        self._seconds: defaultdict[str, list[float]] = defaultdict(list)
        self._workers = workers

    def begin(self, task: Task, now_s: float) -> None:
        """Note that a task was begun at a time [s]."""
        self._running[task.name] = self._waiting.pop(task.name), now_s

    def end(self, task: Task, seconds: float | None) -> None:
        """Note that a task ended, and what time it took [s] if it succeeded."""
        del self._running[task.name]
        if seconds is not None:
            self._seconds[task.scene.family].append(seconds)

    def left_s(self, now_s: float) -> float | None:
        """Return the time until everything is done [s]; `None` before anything is."""
        if not self._seconds:
            return None
        family_s = {family: fmean(seconds) for family, seconds in self._seconds.items()}
        any_s = fmean(seconds for family in self._seconds.values() for seconds in family)
        running = [
            max(0.0, family_s.get(family, any_s) - (now_s - begun_s))
            for family, begun_s in self._running.values()
        ]
        waiting = sum(family_s.get(family, any_s) for family in self._waiting.values())
        return max([(sum(running) + waiting) / self._workers, *running])
