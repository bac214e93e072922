"""A grasp to look at: a strip of pictures and a clip, rendered as the scene was."""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from PIL import Image

from cornergrasps.attempts import Stage, true_grasps
from cornergrasps.engine import Data, mj
from cornergrasps.execute import execute
from cornergrasps.grasp import Grasp
from cornergrasps.plan import Plan
from cornergrasps.recipes import Gripper, Robot
from cornergrasps.scenery import SceneError
from cornerscenes import cuboid
from cornerscenes.camera import Camera, looking_at
from cornerscenes.light import Lamp, Light
from cornerscenes.room import Surface
from cornerscenes.scene import TARGET_ID
from cornerscenes.shape import Material, Part
from cornerscenes.storage import write_whole
from cornerscenes.tables import RecipeError, read, unknown_name
from cornerscenes.workers import ALL_DONE, NOT_STARTED, Stop, Tell, event_channel

# Pictures of the strip, and of the clip; paths per pixel and direction of each.
STRIP, STRIP_PATHS = 6, 8
CLIP, CLIP_PATHS = 18, 4
WIDTH, HEIGHT = 320, 288

# Tiles that are rendered at a time [px].
_TILE_PX = 16

_STEEL = Material((0.30, 0.31, 0.33), roughness=0.35)
_RUBBER = Material((0.05, 0.05, 0.05))
_ORANGE = Material((0.75, 0.25, 0.03), roughness=0.3)
_PAINT = (0.55, 0.53, 0.50)


@dataclass(frozen=True)
class Moment:
    """Where everything is at one time."""

    phase: str
    positions_m: Float[np.ndarray, "b 3"]
    turns: Float[np.ndarray, "b 3 3"]

    @classmethod
    def of(cls, phase: str, data: Data) -> Moment:
        """Return that of a simulation."""
        return cls(phase, data.xpos.copy(), data.xmat.reshape(-1, 3, 3).copy())

    def pose(self, body: int) -> Float[np.ndarray, "4 4"]:
        """Return the pose of a body in the world."""
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = self.turns[body], self.positions_m[body]
        return pose


def main() -> int:
    """Draw a grasp of a scene: SCENE-NAME.png and SCENE-NAME.gif."""
    parser = argparse.ArgumentParser(prog="cornergrasps.strip", description=main.__doc__)
    parser.add_argument("dataset", type=Path, help="folder of the dataset")
    parser.add_argument("grasps", type=Path, help="file of grasps")
    parser.add_argument("output", type=Path, help="folder of the pictures")
    parser.add_argument("--recipes", type=Path, required=True, help="folder of grippers and robots")
    parser.add_argument("--gripper", required=True, help="name of a gripper")
    parser.add_argument("--robot", required=True, help="name of a robot")
    parser.add_argument("--scene", required=True, help="the scene")
    parser.add_argument("--grasp", type=int, help="which of its grasps; the true one if not given")
    parser.add_argument("--name", default="true", help="what the file is called")
    parser.add_argument("--jobs", type=int, help="not used: one process draws")
    options = parser.parse_args()
    stop = Stop()
    tell = event_channel(stop)
    try:
        return _draw(options, tell)
    except (RecipeError, SceneError, OSError, ValueError) as error:
        tell({"event": "error", "message": str(error)})
        return NOT_STARTED


def _draw(options: argparse.Namespace, tell: Tell) -> int:
    gripper = read(Gripper, options.recipes / "grippers" / f"{options.gripper}.toml")
    robot = read(Robot, options.recipes / "robots" / f"{options.robot}.toml")
    stage = Stage(options.dataset, options.scene, robot, gripper)
    grasp, knows_target = _grasp(options, stage), options.grasp is None
    planned = stage.planned(grasp, knows_target)
    if isinstance(planned, str):
        raise SceneError(f"{options.scene}: nothing to see, the robot does not begin: {planned}")
    moments: list[Moment] = []

    def watch(phase: str, data: Data) -> None:
        moments.append(Moment.of(phase, data))

    result = execute(stage.model, stage.data, gripper, planned, watch)
    studio = Studio(options.dataset / options.scene, stage, planned)
    wanted = [(i, STRIP_PATHS) for i in _spread(len(moments), STRIP)]
    wanted += [(i, CLIP_PATHS) for i in _spread(len(moments), CLIP)]
    pictures = []
    for count, (place, paths) in enumerate(wanted):
        tell({"event": "drawing", "picture": count + 1, "of": len(wanted)})
        pictures.append(studio.picture(moments[place], paths))
    strip, clip = pictures[:STRIP], pictures[STRIP:]
    name = "".join(c if c.isalnum() or c in "-_.=" else "_" for c in options.name)
    options.output.mkdir(parents=True, exist_ok=True)
    png, gif = (options.output / f"{options.scene}-{name}.{end}" for end in ("png", "gif"))
    _save(png, Image.fromarray(np.concatenate(strip, axis=1)))
    first, *rest = (Image.fromarray(picture) for picture in clip)
    _save(gif, first, save_all=True, append_images=rest, duration=120, loop=0)
    tell({"event": "drawn", "path": str(png), "words": f"{options.scene}: {result.outcome}"})
    tell({"event": "drawn", "path": str(gif), "words": "the same as a clip"})
    return ALL_DONE


def _save(path: Path, picture: Image.Image, **options: Any) -> None:
    from io import BytesIO

    content = BytesIO()
    picture.save(content, format=path.suffix[1:], **options)
    write_whole(path, content.getvalue())


def _grasp(options: argparse.Namespace, stage: Stage) -> Grasp:
    """Return the wanted grasp: one of the file's, or the first true one that is reached."""
    if options.grasp is None:
        truth = json.loads((options.dataset / options.scene / "truth.json").read_text())
        grasps = true_grasps(truth)
        reached = (g for g in grasps if not isinstance(stage.planned(g, True), str))
        return next(reached, grasps[0])
    told = [json.loads(line) for line in options.grasps.read_text().splitlines()]
    of_scene = {line["scene"]: line["grasps"] for line in told}
    if options.scene not in of_scene:
        raise RecipeError(unknown_name("scene", options.scene, sorted(of_scene)))
    return stage.told(of_scene[options.scene][options.grasp])


def _spread(count: int, wanted: int) -> list[int]:
    return [round(place) for place in np.linspace(0, count - 1, wanted)]


class Studio:
    """A scene in its own light, and a camera that sees target and gripper.

    Parameters
    ----------
    folder : Path
        The scene's.
    stage : Stage
        Its model.
    plan : Plan
        What the robot does.
    """

    def __init__(self, folder: Path, stage: Stage, plan: Plan) -> None:
        from cornerscenes import mitsuba_backend

        mitsuba_backend.choose_variant()
        self._backend = mitsuba_backend
        self._stage = stage
        described = json.loads((folder / "scene.json").read_text(encoding="utf-8"))
        self._light = _light(described["light"])
        self._surfaces = tuple(
            Surface(name, corners, np.tile(np.array(_PAINT), (2, 2, 1)))
            for name, corners in stage.scenery.surfaces_m.items()
        )
        colour = tuple(described["target"]["parts"][0]["colour"])
        self._target = cuboid.sharp(tuple(stage.scenery.size_m), Material(colour, 0.3), {})
        self._camera = Camera.with_field_of_view(WIDTH, HEIGHT, 40.0)
        self._pose = _viewpoint(stage, plan)

    def picture(self, moment: Moment, paths: int) -> np.ndarray:
        """Return a moment as an sRGB picture."""
        backend, model = self._backend, self._stage.model.model
        below = np.array([0.0, 0.0, 0.5 * self._stage.scenery.size_m[2]])
        target = moment.pose(model.body("target").id)
        target[:3, 3] -= target[:3, :3] @ below
        solids = [backend.Solid(TARGET_ID, part, target) for part in self._target]
        for thing in self._stage.scenery.things:
            solids += [backend.Solid(10, part, thing.world_from_object) for part in thing.parts]
        solids += [backend.Solid(20, part, pose) for part, pose in self._robot(moment)]
        world = backend.World(solids, self._surfaces, self._light, 5)
        view = world.seen_by(self._camera, self._pose)
        columns, rows = WIDTH // _TILE_PX, HEIGHT // _TILE_PX
        tiles = np.array([[x, y] for y in range(rows) for x in range(columns)]) * _TILE_PX
        samples = (_TILE_PX * paths) ** 2
        (found,) = view.passes(tiles, _TILE_PX, _TILE_PX, samples, 1, "strip")
        image = found.reshape(rows, columns, _TILE_PX, _TILE_PX, 3).transpose(0, 2, 1, 3, 4)
        linear = np.clip(image.reshape(HEIGHT, WIDTH, 3), 0.0, 1.0)
        return np.round(255.0 * linear ** (1.0 / 2.2)).astype(np.uint8)

    def _robot(self, moment: Moment) -> list[tuple[Part, Float[np.ndarray, "4 4"]]]:
        """Return the meshes of the robot, as the model has its geometries."""
        model = self._stage.model.model
        found = []
        for geometry in sorted(self._stage.model.robot | self._stage.model.platform):
            name = model.geom(geometry).name
            own = np.eye(4)
            own[:3, :3] = _matrix(model.geom_quat[geometry])
            own[:3, 3] = model.geom_pos[geometry]
            size = model.geom_size[geometry]
            kind = model.geom_type[geometry]
            if kind == mj.mjtGeom.mjGEOM_BOX:
                materials = {"platform": _ORANGE, "left pad": _RUBBER, "right pad": _RUBBER}
                part = _box(2.0 * size, materials.get(name, _STEEL))
            elif kind == mj.mjtGeom.mjGEOM_CYLINDER:
                part = _box(2.0 * size[[0, 0, 1]], _ORANGE)
            else:
                length = size[1] if kind == mj.mjtGeom.mjGEOM_CAPSULE else 0.0
                part = _capsule(size[0], length, _ORANGE)
            found.append((part, moment.pose(model.geom_bodyid[geometry]) @ own))
        return found


def _viewpoint(stage: Stage, plan: Plan) -> Float[np.ndarray, "4 4"]:
    """Return a camera from which the target and what grasps it are seen.

    Where a gripper flies, it looks from where the colour camera does, from nearer; an arm hides
    what it grasps from there, so it is looked at from the side, the one towards the camera.
    """
    eye, centre = stage.scenery.world_from_camera[:3, 3], stage.scenery.centre_m
    way = eye - centre
    if stage.robot.arm is not None:
        along = centre[:2] - plan.root_m[:2]
        along = along / np.linalg.norm(along)
        aside = np.array([-along[1], along[0]])
        aside = aside if aside @ way[:2] > 0.0 else -aside
        way = np.array([*(0.9 * aside - 0.35 * along), 0.55])
        return looking_at(centre + 1.35 * way / np.linalg.norm(way), centre + 0.08 * np.eye(3)[2])
    if np.hypot(*way[:2]) < 0.3 * np.linalg.norm(way):  # from straight above little is to be seen
        way = np.array([-0.8, -0.8, 0.9])
    return looking_at(centre + 0.85 * way / np.linalg.norm(way), centre + 0.05 * np.eye(3)[2])


def _light(content: dict[str, Any]) -> Light:
    lamps = tuple(
        Lamp(
            lamp["kind"],
            tuple(lamp["strength"]),
            tuple(lamp["position_m"]),
            tuple(lamp["aim_m"]),
            lamp["size_m"],
        )
        for lamp in content["lamps"]
    )
    zenith, horizon, nadir = (tuple(content[key]) for key in ("zenith", "horizon", "nadir"))
    return Light(zenith, horizon, nadir, lamps)


def _box(size_m: Float[np.ndarray, "3"], material: Material) -> Part:
    """Return a box about the origin."""
    vertices = cuboid.vertices(tuple(size_m)) - [0.0, 0.0, 0.5 * size_m[2]]
    triangles = np.array([[f[0], f[k], f[k + 1]] for f in cuboid.FACES for k in (1, 2)])
    return Part("box", vertices, triangles, material, smooth=False)


def _capsule(radius_m: float, half_length_m: float, material: Material) -> Part:
    """Return a capsule about the origin, along z."""
    rings, around = 12, 24
    polar = np.linspace(0.0, np.pi, rings + 1)[:, None]
    turn = np.linspace(0.0, 2.0 * np.pi, around, endpoint=False)[None]
    z = radius_m * np.cos(polar) + np.where(polar <= 0.5 * np.pi, half_length_m, -half_length_m)
    ring = radius_m * np.sin(polar)
    vertices = np.stack([ring * np.cos(turn), ring * np.sin(turn), z + 0.0 * turn], axis=-1)
    first = np.arange(rings)[:, None] * around
    here, beside = np.arange(around), (np.arange(around) + 1) % around
    a, b, c, d = first + here, first + around + here, first + around + beside, first + beside
    triangles = np.concatenate(
        [np.stack([a, b, c], axis=-1).reshape(-1, 3), np.stack([a, c, d], axis=-1).reshape(-1, 3)]
    )
    points = vertices.reshape(-1, 3)
    corners = points[triangles]
    area = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    return Part("capsule", points, triangles[area > 1e-12], material)


def _matrix(turn: Float[np.ndarray, "4"]) -> Float[np.ndarray, "3 3"]:
    found = np.zeros(9)
    mj.mju_quat2Mat(found, turn)
    return found.reshape(3, 3)


if __name__ == "__main__":
    sys.exit(main())
