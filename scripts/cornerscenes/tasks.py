"""The scenes of a suite as tasks: each can be done alone, by any process, on any machine."""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
import re
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from cornerscenes.dataset import FORMAT, Dataset, Renderer
from cornerscenes.recipes import Family, FilmRecipe, RecipeError, SceneRecipe, Suite, read
from cornerscenes.storage import storage_at

# What computes the content of a scene.
PACKAGES = ("drjit", "mitsuba", "numpy", "scipy")

# Not among the sources that a recipe's hash covers: these decide when, where and by whom a scene is
# rendered, not what is in it.
ORCHESTRATION = ("estimate.py", "render.py", "storage.py", "workers.py")


@dataclass(frozen=True)
class Task:
    """One scene to render, with all that decides its content.

    Attributes
    ----------
    suite_name : str
        The suite.
    film : FilmRecipe
        How finely it is rendered.
    scene : SceneRecipe
        The scene.
    family : Family
        Its family.
    recipe_sha256 : str
        Hash of all of these and of what renders them.
    """

    suite_name: str
    film: FilmRecipe
    scene: SceneRecipe
    family: Family
    recipe_sha256: str

    @property
    def name(self) -> str:
        """The scene's name."""
        return self.scene.name

    @property
    def key(self) -> str:
        """The name that the scene's random streams and seeds start from."""
        return f"{self.suite_name}/{self.scene.name}"


@dataclass(frozen=True)
class Setting:
    """How a task is done, which does not change what comes out.

    Attributes
    ----------
    address : str
        Folder or address of the dataset.
    variant : str
        Mitsuba's variant.
    threads : int
        The renderer's threads.
    """

    address: str
    variant: str
    threads: int


@dataclass(frozen=True)
class Rendered:
    """What became of a task.

    Attributes
    ----------
    visible_fraction : float
        Share of the target that no object hides.
    seconds, core_seconds : float
        How long it took, and what that was of one core's time.
    bytes : int
        Size of its files.
    """

    visible_fraction: float
    seconds: float
    core_seconds: float
    bytes: int


def tasks_of(suite_name: str, recipes: Path) -> list[Task]:
    """Read a suite and its families; return its scenes in their order.

    Raises
    ------
    RecipeError
        When a recipe is missing or holds what it must not.
    """
    suite = read(Suite, recipes / "suites" / f"{suite_name}.toml")
    names = sorted({scene.family for scene in suite.scenes})
    families = {name: read(Family, recipes / "families" / f"{name}.toml") for name in names}
    return [
        Task(
            suite_name,
            suite.film,
            scene,
            families[scene.family],
            recipe_hash(suite_name, scene, suite.film, families[scene.family]),
        )
        for scene in suite.scenes
    ]


def recipe_hash(suite_name: str, scene: SceneRecipe, film: FilmRecipe, family: Family) -> str:
    """Return the hash of all that decides a scene's content: its recipe and its generators."""
    content = {
        "format": FORMAT,
        "suite": suite_name,
        "scene": scene.model_dump(),
        "film": film.model_dump(),
        "family": family.model_dump(exclude={"summary"}),
        "generators": generators(),
    }
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


@cache
def generators() -> dict[str, str]:
    """Return the versions of what makes a scene: packages, and this package's sources."""
    sources = hashlib.sha256()
    package = Path(__file__).parent
    for path in sorted(package.rglob("*.py")):
        if path.relative_to(package).as_posix() not in ORCHESTRATION:
            sources.update(path.read_bytes())
    return {
        "cornerscenes": sources.hexdigest(),
        **{name: importlib.metadata.version(name) for name in PACKAGES},
    }


def selected(tasks: Sequence[Task], scenes: str | None, shard: str | None) -> list[Task]:
    """Return the tasks that a run is to do.

    Parameters
    ----------
    tasks : Sequence[Task]
        All scenes of a suite.
    scenes : str or None
        ``A..B``: those from number A up to, but without, number B, counted from 0; or a scene's
        name.
    shard : str or None
        ``I/N``: every N-th one, those whose number in the suite leaves the remainder I, 0 to N - 1.

    Raises
    ------
    RecipeError
        When there are no such scenes.
    """
    numbers = range(len(tasks))
    if scenes is not None:
        numbers = range(*_bounds(tasks, scenes))
    if shard is not None:
        found = re.fullmatch(r"(\d+)/(\d+)", shard)
        index, count = (int(found[1]), int(found[2])) if found else (0, 0)
        if index >= count:
            raise RecipeError(f"--shard is {shard!r}, must be I/N with I from 0 to N - 1")
        numbers = [number for number in numbers if number % count == index]
    return [tasks[number] for number in numbers]


def _bounds(tasks: Sequence[Task], scenes: str) -> tuple[int, int]:
    names = [task.name for task in tasks]
    if scenes in names:
        return names.index(scenes), names.index(scenes) + 1
    found = re.fullmatch(r"(\d*)\.\.(\d*)", scenes)
    if found:
        first, end = int(found[1] or 0), int(found[2] or len(tasks))
        if first < end <= len(tasks):
            return first, end
    raise RecipeError(
        f"--scenes is {scenes!r}, must be A..B within 0..{len(tasks)}, or the name of a scene: "
        f"{names[0]} to {names[-1]}"
    )


# What follows runs in a worker, and imports the renderer there: where nothing is missing, it is
# never loaded.


def choose_variant(wanted: str | None) -> str:
    """Return the renderer's variant that this machine can run, the fastest if none is wanted."""
    from cornerscenes import mitsuba_backend

    return mitsuba_backend.choose_variant(wanted)


class Stopwatch:
    """Measures a time, and what this process used of the machine meanwhile.

    Parameters
    ----------
    variant : str
        The renderer's variant.
    threads : int
        The renderer's threads.
    """

    def __init__(self, variant: str, threads: int) -> None:
        self._on_gpu = variant.startswith("cuda")
        self._threads = threads
        self._began_s = time.monotonic(), time.process_time()

    def seconds(self) -> float:
        """Return the time since it began [s]."""
        return time.monotonic() - self._began_s[0]

    def core_seconds(self) -> float:
        """Return the time of one core that was used [s].

        It does not count what other programs took, where these can be told apart: on a processor.
        """
        if self._on_gpu:
            return self._threads * self.seconds()
        return time.process_time() - self._began_s[1]


def prepare(variant: str) -> None:
    """Load the renderer, so that it does not count as time of a scene."""
    from cornerscenes import layout, mitsuba_backend, scene_files  # noqa: F401

    mitsuba_backend.choose_variant(variant)


def write_scene(task: Task, folder: Path, threads: int) -> float:
    """Render a scene by what was prepared, write its files, return the target's visible share."""
    import drjit

    from cornerscenes import scene_files
    from cornerscenes.layout import lay_out

    drjit.set_thread_count(threads)
    scene = lay_out(task.suite_name, task.scene, task.family)
    return scene_files.write(folder, scene, task.film, task.scene, task.key)


def render_one(task: Task, setting: Setting) -> Rendered:
    """Render one scene into its dataset."""
    prepare(setting.variant)
    stopwatch = Stopwatch(setting.variant, setting.threads)
    renderer = Renderer(
        name="mitsuba", version=importlib.metadata.version("mitsuba"), variant=setting.variant
    )
    dataset = Dataset(storage_at(setting.address), task.suite_name)
    fraction, size_bytes = dataset.add(
        task.name,
        task.recipe_sha256,
        renderer,
        lambda folder: write_scene(task, folder, setting.threads),
    )
    return Rendered(fraction, stopwatch.seconds(), stopwatch.core_seconds(), size_bytes)
