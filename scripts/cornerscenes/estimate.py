"""How long rendering takes and how much it fills: beforehand, and what is left while it goes on.

Both come from scenes rendered on this machine. What a scene cost is noted in a log beside its
dataset. For a family with nothing in the log, scenes are rendered at a few of their samples.
"""

from __future__ import annotations

import hashlib
import json
import math
import platform
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import fmean, stdev

from pydantic import BaseModel, ConfigDict, ValidationError

from cornerscenes.recipes import FilmRecipe
from cornerscenes.storage import Folder, Storage
from cornerscenes.tasks import Stopwatch, Task, prepare, write_scene

# The log lies hidden in the dataset's folder. It is no part of the dataset: nothing else reads it.
LOG = ".costs.jsonl"

# Scenes of a family that are probed, the second and later ones only within this time [s].
PROBES_PER_FAMILY = 3
PROBING_S = 60.0

# A probe takes ever more samples until it takes this much longer than with the fewest.
DIFFERENCE = 1.3

# What one probe says of a family's scenes, as a share: until two of any family are known.
SPREAD = 0.5

# What a probe's extrapolation may be wrong by, as a share, for all scenes alike. Measured by
# `python -m studies.estimates`.
EXTRAPOLATION = 0.2


class Cost(BaseModel):
    """What one scene cost: processor time [s] of one core, size of its files [bytes]."""

    model_config = ConfigDict(frozen=True)

    core_seconds: float
    bytes: int


class _Line(Cost):
    """A line of the log: a cost, and whose."""

    machine: str
    variant: str
    kind: str
    scene: str


class CostLog:
    """What scenes cost that were rendered on this machine into one dataset.

    Parameters
    ----------
    storage : Storage
        Where the dataset is. Only a folder has a log.
    """

    def __init__(self, storage: Storage) -> None:
        self._path = storage.path / LOG if isinstance(storage, Folder) else None

    def note(self, task: Task, variant: str, cost: Cost) -> None:
        """Add a line. Several processes may do so: each line is written at once."""
        if self._path is None:
            return
        whose = {"machine": platform.node(), "variant": variant, "kind": kind_of(task)}
        line = _Line(scene=task.name, **whose, **cost.model_dump())
        with self._path.open("a", encoding="utf-8") as log:
            log.write(line.model_dump_json() + "\n")

    def costs(self, variant: str) -> dict[str, list[Cost]]:
        """Return what scenes cost with a variant, by their kind; a scene's last time counts."""
        found: defaultdict[str, dict[str, Cost]] = defaultdict(dict)
        if self._path is not None and self._path.is_file():
            for text in self._path.read_text(encoding="utf-8").splitlines():
                try:
                    line = _Line.model_validate_json(text)
                except ValidationError:  # written by halves, or by another version
                    continue
                if (line.machine, line.variant) == (platform.node(), variant):
                    found[line.kind][line.scene] = line
        return {kind: list(scenes.values()) for kind, scenes in found.items()}


def kind_of(task: Task) -> str:
    """Return the name of the scenes that should cost about the same: family and film are equal."""
    recipe = task.family.model_dump(exclude={"summary"}), task.film.model_dump()
    digest = hashlib.sha256(json.dumps(recipe, sort_keys=True).encode()).hexdigest()
    return f"{task.scene.family}-{digest[:12]}"


@dataclass(frozen=True)
class Sum:
    """A sum over scenes with its uncertainty: 19 of 20 should lie between low and high."""

    expected: float
    low: float
    high: float

    def divided_by(self, divisor: float) -> Sum:
        """Return the sum of as many parts of it."""
        return Sum(self.expected / divisor, self.low / divisor, self.high / divisor)


@dataclass(frozen=True)
class FamilyCost:
    """What the scenes of one family are expected to cost, each.

    Attributes
    ----------
    family : str
        The family.
    scenes : int
        How many are to be rendered.
    rendered, probed : int
        From how many this is known: rendered as they are, or at a few of their samples.
    core_seconds, bytes : float
        The mean.
    """

    family: str
    scenes: int
    rendered: int
    probed: int
    core_seconds: float
    bytes: float


def to_probe(tasks: Sequence[Task], known: Mapping[str, list[Cost]]) -> list[Task]:
    """Return scenes of each kind of which nothing is known: one of each, then a second of each."""
    kinds: defaultdict[str, list[Task]] = defaultdict(list)
    for task in tasks:
        if kind_of(task) not in known:
            kinds[kind_of(task)].append(task)
    rounds: list[list[Task]] = [[] for _ in range(PROBES_PER_FAMILY)]
    for scenes in kinds.values():
        step = max(1, len(scenes) // PROBES_PER_FAMILY)
        for number, task in enumerate(scenes[::step][:PROBES_PER_FAMILY]):
            rounds[number].append(task)
    return [task for round_ in rounds for task in round_]


def in_time(tasks: Sequence[Task]) -> Iterator[Task]:
    """Yield the first scene of each kind, and others as long as there is time to probe."""
    begun_s = time.monotonic()
    kinds = set()
    for task in tasks:
        if kind_of(task) not in kinds or time.monotonic() - begun_s < PROBING_S:
            kinds.add(kind_of(task))
            yield task


def probe(task: Task, variant: str, threads: int) -> Cost:
    """Render a scene at a few of its samples, and tell from that what it costs.

    Some of the time does not depend on the samples. So it is rendered at the fewest possible first,
    and then at more, until they make a difference.
    """
    prepare(variant)
    points: list[tuple[float, float]] = []
    size_bytes, paths = 0, 0.0
    for film in _films(task.film):
        with tempfile.TemporaryDirectory() as temporary:
            folder = Path(temporary)
            stopwatch = Stopwatch(variant, threads)
            write_scene(replace(task, film=film), folder, threads)
            core_seconds = stopwatch.core_seconds()
            size_bytes = sum(file.stat().st_size for file in folder.iterdir())
            described = json.loads((folder / "scene.json").read_text(encoding="utf-8"))
        points.append((_paths(film, described), core_seconds))
        paths = _paths(task.film, described)
        if core_seconds > DIFFERENCE * points[0][1]:
            break
    return Cost(core_seconds=_extrapolated(points, paths), bytes=size_bytes)


def _films(film: FilmRecipe) -> list[FilmRecipe]:
    """Return this recipe at ever more samples, each time four times as many, up to its own."""
    passes = 2  # as few as there can be
    most = max(film.fovea_samples, film.periphery_samples)
    films = []
    samples = passes
    while samples < most:
        fewer = {
            "passes": passes,
            "fovea_samples": min(samples, film.fovea_samples),
            "periphery_samples": min(samples, film.periphery_samples),
        }
        films.append(film.model_copy(update=fewer))
        samples *= 4
    return [*films, film]


def _paths(film: FilmRecipe, described: Mapping[str, dict]) -> float:
    """Return how many paths a film takes, of a scene described by its scene.json."""
    x0, y0, x1, y1 = described["film"]["fovea_px"]
    pixels = described["camera"]["width"] * described["camera"]["height"]
    cells = (x1 - x0) * (y1 - y0) * film.oversampling**2
    return float(pixels * film.periphery_samples + cells * film.fovea_samples)


def _extrapolated(points: Sequence[tuple[float, float]], paths: float) -> float:
    """Return the time [s] that so many paths take, on a line through the first and last point.

    A point is a number of paths and the time that they took [s].
    """
    (first_paths, first_s), (last_paths, last_s) = points[0], points[-1]
    slope = (last_s - first_s) / (last_paths - first_paths) if last_paths > first_paths else 0.0
    return last_s + max(0.0, slope) * (paths - last_paths)


def estimate(
    tasks: Sequence[Task],
    rendered: Mapping[str, list[Cost]],
    probed: Mapping[str, list[Cost]],
) -> tuple[list[FamilyCost], Sum, Sum]:
    """Return what scenes cost by family, and in sum: one core's seconds, and bytes.

    Parameters
    ----------
    tasks : Sequence[Task]
        What is to be rendered.
    rendered, probed : Mapping[str, list[Cost]]
        What is known of each kind.
    """
    kinds: defaultdict[str, list[Task]] = defaultdict(list)
    for task in tasks:
        kinds[kind_of(task)].append(task)
    costs = {kind: rendered.get(kind) or probed.get(kind) or [] for kind in kinds}
    # A kind of which nothing is known, because its probes failed, is taken to be like the others.
    any_cost = [cost for known in costs.values() for cost in known]
    costs = {kind: known or any_cost for kind, known in costs.items()}
    families = [
        FamilyCost(
            family=scenes[0].scene.family,
            scenes=len(scenes),
            rendered=len(rendered.get(kind, [])),
            probed=0 if rendered.get(kind) else len(probed.get(kind, [])),
            core_seconds=fmean(cost.core_seconds for cost in costs[kind]),
            bytes=fmean(cost.bytes for cost in costs[kind]),
        )
        for kind, scenes in kinds.items()
    ]
    counts = {kind: len(scenes) for kind, scenes in kinds.items()}
    seconds = {kind: [cost.core_seconds for cost in known] for kind, known in costs.items()}
    sizes = {kind: [float(cost.bytes) for cost in known] for kind, known in costs.items()}
    by_probes = sum(counts[kind] * fmean(seconds[kind]) for kind in kinds if not rendered.get(kind))
    return families, _sum(counts, seconds, EXTRAPOLATION * by_probes), _sum(counts, sizes, 0.0)


def _sum(counts: Mapping[str, int], known: Mapping[str, Sequence[float]], systematic: float) -> Sum:
    """Return the sum over kinds of as many scenes each, from what is known of some of them.

    The relative spread within a kind is taken to be the same in all: few are known of each.
    """
    deviations = [
        (len(values) - 1, (stdev(values) / fmean(values)) ** 2)
        for values in known.values()
        if len(values) > 1
    ]
    degrees = sum(weight for weight, _ in deviations)
    spread = math.sqrt(sum(w * square for w, square in deviations) / degrees) if degrees else SPREAD
    expected = sum(count * fmean(known[kind]) for kind, count in counts.items())
    variance = systematic**2 + sum(
        (spread * fmean(known[kind])) ** 2 * (count**2 / len(known[kind]) + count)
        for kind, count in counts.items()
    )
    # As a factor, so that the low end stays above nothing.
    factor = math.exp(2.0 * math.sqrt(variance) / expected) if expected > 0.0 else 1.0
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
