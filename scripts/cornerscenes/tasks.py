"""The scenes of a suite as tasks: each can be done alone, by any process, on any machine."""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
import platform
import re
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from cornerscenes.dataset import FORMAT, Dataset, Renderer
from cornerscenes.library import Library
from cornerscenes.recipes import Family, FilmRecipe, SceneRecipe, Suite
from cornerscenes.storage import storage_at
from cornerscenes.tables import RecipeError, read

if TYPE_CHECKING:
    from cornerscenes.mitsuba_backend import World
    from cornerscenes.scene import Scene

# What computes the content of a scene.
PACKAGES = ("drjit", "mitsuba", "numpy", "scipy")

# Not among the sources that a recipe's hash covers: these decide when, where and by whom a scene is
# rendered, not what is in it.
ORCHESTRATION = (
    "estimate.py",
    "ray_workers.py",
    "render.py",
    "schemas.py",
    "storage.py",
    "workers.py",
)


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
    library : Library
        The materials, backgrounds and lights that the family names.
    recipe_sha256 : str
        Hash of all of these and of what renders them.
    """

    suite_name: str
    film: FilmRecipe
    scene: SceneRecipe
    family: Family
    library: Library
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
    seconds : float
        How long it took.
    bytes : int
        Size of its files.
    """

    visible_fraction: float
    seconds: float
    bytes: int


def tasks_of(suite_name: str, recipes: Path) -> list[Task]:
    """Read a suite and its families; return its scenes in their order.

    Raises
    ------
    RecipeError
        When a recipe is missing or holds what it must not.
    """
    suite = read(Suite, recipes / "suites" / f"{suite_name}.toml")
    scenes = suite.all_scenes(suite_name)
    names = sorted({scene.family for scene in scenes})
    families = {name: read(Family, recipes / "families" / f"{name}.toml") for name in names}
    library = Library.of(recipes)
    used = {name: library.used_by(family) for name, family in families.items()}
    return [
        Task(
            suite_name=suite_name,
            film=suite.film,
            scene=scene,
            family=families[scene.family],
            library=used[scene.family],
            recipe_sha256=recipe_hash(
                suite_name, scene, suite.film, families[scene.family], used[scene.family]
            ),
        )
        for scene in scenes
    ]


def recipe_hash(
    suite_name: str, scene: SceneRecipe, film: FilmRecipe, family: Family, library: Library
) -> str:
    """Return the hash of all that decides a scene's content: its recipe and its generators."""
    content = {
        "format": FORMAT,
        "suite": suite_name,
        "scene": asdict(scene),
        "film": film.model_dump(),
        "family": family.model_dump(exclude={"summary"}),
        "library": library.described(),
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


def scene_of(task: Task, setting: Setting) -> tuple[Scene, World]:
    """Start the renderer and return a task's scene, and the same as the renderer holds it.

    Raises
    ------
    RecipeError
        When what is installed here would not render the scene that the task names.
    """
    import drjit

    from cornerscenes.layout import lay_out
    from cornerscenes.mitsuba_backend import World

    here = recipe_hash(task.suite_name, task.scene, task.film, task.family, task.library)
    if here != task.recipe_sha256:
        raise RecipeError(
            f"the sources or packages of its worker (on {platform.node()}) are not those that this "
            f"run began with; render again when nothing changes them any more"
        )
    choose_variant(setting.variant)
    drjit.set_thread_count(setting.threads)
    scene = lay_out(task.suite_name, task.scene, task.family, task.library)
    return scene, World.of(scene, task.film.max_depth)


def render_one(task: Task, setting: Setting) -> Rendered:
    """Render one scene into its dataset."""
    from cornerscenes import scene_files

    started_s = time.monotonic()
    scene, world = scene_of(task, setting)
    renderer = Renderer(
        name="mitsuba", version=importlib.metadata.version("mitsuba"), variant=setting.variant
    )
    dataset = Dataset(storage_at(setting.address), task.suite_name)
    fraction, size_bytes = dataset.add(
        task.name,
        task.recipe_sha256,
        renderer,
        lambda folder: scene_files.write(folder, scene, world, task.film, task.scene, task.key),
    )
    return Rendered(fraction, time.monotonic() - started_s, size_bytes)
