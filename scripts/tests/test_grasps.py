"""Grasps in physics: the arm gets where it says, and what goes wrong is called what it is."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import Delaunay

from cornergrasps import arm as arms
from cornergrasps.attempts import SceneTask, Stage, carry_out, true_grasps
from cornergrasps.clutter import CELL_M, pieces
from cornergrasps.engine import mj
from cornergrasps.execute import Result, execute
from cornergrasps.grasp import Grasp
from cornergrasps.model import build, reach_m
from cornergrasps.plan import Plan, place, plan
from cornergrasps.recipes import Gripper, Robot
from cornergrasps.scenery import SceneError, Scenery, Thing
from cornergrasps.strip import Moment, Studio
from cornerscenes import room
from cornerscenes.camera import looking_at, standing
from cornerscenes.objects import BUILDERS
from cornerscenes.scene import FIRST_OBJECT_ID
from cornerscenes.shape import Material, Part
from cornerscenes.streams import stream
from cornerscenes.tables import RecipeError, known, read
from tests.scenes import slab

SCENES = Path(__file__).parents[2] / "scenes"
SIZE = np.array([0.14, 0.10, 0.12])
UP = np.array([0.0, 0.0, 1.0])


def gripper(**changes: float) -> Gripper:
    table = read(Gripper, SCENES / "grippers" / "parallel-160.toml")
    return table.model_copy(update=changes)


def robot(name: str = "flying") -> Robot:
    return read(Robot, SCENES / "robots" / f"{name}.toml")


def scenery(*things: Thing, centre: tuple[float, float] = (0.0, 0.0)) -> Scenery:
    """Return a cuboid on the floor, the walls half a metre behind it."""
    return Scenery(
        name="made up",
        size_m=SIZE,
        world_from_target=standing(*centre, 0.0),
        things=things,
        surfaces_m=room.corners(0.5, 0.5, 3.0, 1.4),
        world_from_camera=looking_at(np.array([-0.5, -0.4, 0.7]), np.zeros(3)),
    )


def from_above(opening_m: float | None = 0.10) -> Grasp:
    """Return the true grasp of the top, jaws across its shorter side, y."""
    return Grasp(np.array([0.0, 0.0, SIZE[2]]), UP, np.array([0.0, 1.0, 0.0]), opening_m)


def carried_out(
    grasp: Grasp, *things: Thing, by: str = "flying", of: Gripper | None = None
) -> str | Result:
    made, used = scenery(*things), of or gripper()
    model = build(made, robot(by), used)
    data = mj.MjData(model.model)
    planned = plan(made, robot(by), used, model, data, grasp)
    return planned if isinstance(planned, str) else execute(model, data, used, planned)


def outcome(*arguments: object, **options: object) -> str:
    found = carried_out(*arguments, **options)  # type: ignore[arg-type]
    return found if isinstance(found, str) else found.outcome


def board(x_m: float, y_m: float, yaw_rad: float = 0.0, soft: bool = False) -> Thing:
    """Return an upright board of 2 x 10 cm, 16 cm high."""
    (part,) = slab().shape.parts
    sheet = replace(part, material=Material((0.1, 0.5, 0.1), two_sided=True))
    return Thing("board", (sheet if soft else part,), standing(x_m, y_m, yaw_rad))


def moved(way: np.ndarray, by_m: float) -> Grasp:
    grasp = from_above()
    return replace(grasp, point_m=grasp.point_m + by_m * way)


def test_the_true_grasp_is_lifted_and_does_not_move_between_the_jaws():
    found = carried_out(from_above())
    assert isinstance(found, Result)
    assert found.outcome == "success"
    assert found.slip_mm is not None and found.slip_mm < 0.2
    assert found.pushed_mm < 0.5


def test_what_goes_wrong_is_called_what_it_is():
    jaws = from_above().jaw
    assert outcome(moved(jaws, 0.03)) == "target"  # a finger comes down on it
    assert outcome(moved(-jaws, 0.03)) == "target"
    assert outcome(moved(UP, 0.05)) == "no_contact"  # it closes above it
    assert outcome(moved(-UP, 0.03)) == "target"  # the palm comes down on it
    assert outcome(from_above(0.20)) == "too_wide"
    assert outcome(from_above(), of=gripper(friction=0.01)) in ("dropped", "slipped")
    assert outcome(from_above(), of=gripper(force_n=0.2)) in ("dropped", "slipped")


def test_within_its_clearance_an_error_along_the_jaws_does_no_harm():
    for by_m in (0.003, -0.003):
        assert outcome(moved(from_above().jaw, by_m)) == "success"
    assert outcome(moved(from_above().jaw, 0.003), of=gripper(clearance_m=0.001)) == "target"


def test_what_is_in_the_way_is_named_and_leaves_give_way():
    beside = board(0.0, 0.5 * SIZE[1] + 0.015, yaw_rad=0.5 * np.pi)
    assert outcome(from_above(), beside) == "clutter"
    assert (
        outcome(from_above(), replace(beside, parts=board(0.0, 0.0, soft=True).parts)) == "success"
    )
    front = Grasp(
        np.array([-0.5 * SIZE[0], 0.0, 0.5 * SIZE[2]]), np.array([-1.0, 0, 0]), UP, SIZE[2]
    )
    assert outcome(front) == "ground"  # the lower jaw would be in the floor
    level = replace(front, jaw=np.array([0.0, 1.0, 0.0]), opening_m=SIZE[1])
    assert outcome(level) == "success"
    assert outcome(level, board(-0.5 * SIZE[0] - 0.06, 0.0)) == "clutter"
    made = scenery(centre=(0.0, 0.5 - 0.5 * SIZE[1] - 0.01))
    at_wall = replace(from_above(), point_m=made.centre_m + 0.5 * SIZE[2] * UP)
    model = build(made, robot(), gripper())
    found = plan(made, robot(), gripper(), model, mj.MjData(model.model), at_wall)
    assert found == "wall"


def test_a_point_alone_is_tried_from_above_with_the_jaws_along_the_picture_s_rows():
    camera = looking_at(np.array([-0.5, -0.4, 0.7]), np.zeros(3))
    grasp = Grasp.of([0.0, 0.0, 0.1], None, None, None, camera)
    assert np.allclose(grasp.approach, UP)
    assert np.allclose(grasp.jaw, camera[:3, 0])
    assert grasp.opened_m(gripper()) == gripper().most_opening_m
    assert np.linalg.det(grasp.frame) == pytest.approx(1.0)


@pytest.mark.parametrize("name", ["youbot", "long-arm"])
def test_the_arm_is_where_its_inverse_kinematics_say(name: str):
    used = robot(name)
    assert used.arm is not None
    model = build(scenery(), used, gripper())
    data = mj.MjData(model.model)
    hand = model.model.body("hand").id
    generator = np.random.default_rng(1)
    low, high = np.radians(np.array(used.arm.limits_deg)).T
    found = 0
    for _ in range(200):
        joints = generator.uniform(low, high)
        still = Plan(np.zeros(3), np.array([1.0, 0, 0, 0]), joints[None], joints[None], 0.1, None)
        place(model, data, still, joints)
        mj.mj_kinematics(model.model, data)
        position, turn = data.xpos[hand].copy(), data.xmat[hand].reshape(3, 3).copy()
        approach = turn[:, 2]
        flange = position - reach_m(gripper()) * approach
        bearing = joints[0]
        forwards = np.array([np.cos(bearing), np.sin(bearing), 0.0])
        tilt = float(np.arctan2(approach @ forwards, approach[2]))
        solved = [
            pitches
            for elbow in (1, -1)
            for pitches, within in [
                arms.solutions(used.arm, np.array([flange @ forwards, flange[2]]), tilt, elbow)
            ]
            if within
        ]
        assert min(np.abs(pitches - joints[1:4]).max() for pitches in solved) < 1e-6
        roll = arms.roll(used.arm, bearing, tilt, turn[:, 0])
        assert roll is not None
        assert abs((roll - joints[4] + 0.5 * np.pi) % np.pi - 0.5 * np.pi) < 1e-6
        found += 1
    assert found == 200


def test_an_arm_stands_where_nothing_is_and_lifts_what_the_gripper_lifts():
    made, used = scenery(), robot("long-arm")
    model = build(made, used, gripper())
    data = mj.MjData(model.model)
    planned = plan(made, used, gripper(), model, data, from_above())
    assert isinstance(planned, Plan)
    hand = model.model.body("hand").id
    for joints, wanted in zip(planned.there, from_above().way_there_m(gripper()), strict=True):
        place(model, data, planned, joints)
        mj.mj_kinematics(model.model, data)
        assert np.linalg.norm(data.xpos[hand] - wanted) < 1e-9
    assert np.allclose(data.xmat[hand].reshape(3, 3)[:, 2], -UP)
    assert abs(data.xmat[hand].reshape(3, 3)[:, 0] @ from_above().jaw) == pytest.approx(1.0)
    assert outcome(from_above(), by="long-arm") == "success"
    high = replace(from_above(), point_m=np.array([0.0, 0.0, 2.0]))
    assert outcome(high, by="youbot") == "unreachable"


def test_a_grasp_comes_to_the_same_every_time():
    for grasp in (from_above(), moved(from_above().jaw, 0.004), moved(UP, 0.02)):
        assert carried_out(grasp) == carried_out(grasp)


def test_pieces_cover_what_is_rigid_and_leave_free_what_is_hollow():
    (part,) = slab(size=(0.1, 0.1, 0.1)).shape.parts
    assert len(pieces((part,))) == 1  # a box is convex
    second = replace(part, vertices=part.vertices + 0.3 * np.eye(3)[1])
    assert len(pieces((part, second))) == 2
    corner = Part(  # two walls that meet: an L seen from above
        "corner",
        np.concatenate([part.vertices * [2.0, 0.1, 1.0], part.vertices * [0.1, 2.0, 1.0]]),
        np.concatenate([part.triangles, part.triangles + 8]),
        part.material,
        smooth=False,
    )
    hulls = [Delaunay(points) for points in pieces((corner,))]
    covered = np.array([hull.find_simplex(corner.vertices) >= 0 for hull in hulls]).any(axis=0)
    assert covered.all()
    hollow = np.array([[0.06, 0.06, 0.05], [-0.06, 0.06, 0.05], [0.03 + CELL_M, 0.03, 0.02]])
    assert not any((hull.find_simplex(hollow) >= 0).any() for hull in hulls)


def test_every_committed_gripper_and_robot_is_valid_and_a_wrong_one_says_why(tmp_path: Path):
    for name in known(SCENES / "grippers"):
        read(Gripper, SCENES / "grippers" / f"{name}.toml")
    for name in known(SCENES / "robots"):
        read(Robot, SCENES / "robots" / f"{name}.toml")
    text = (SCENES / "grippers" / "youbot.toml").read_text()
    deep = tmp_path / "deep.toml"
    deep.write_text(text.replace("depth_m = 0.025", "depth_m = 0.05"))
    with pytest.raises(RecipeError, match="palm would be in the target"):
        read(Gripper, deep)


def test_a_scene_is_rebuilt_from_its_file_or_refused(tiny: Path, tmp_path: Path):
    made = Scenery.read(tiny / "one")
    described = json.loads((tiny / "one" / "scene.json").read_text())
    truth = json.loads((tiny / "one" / "truth.json").read_text())
    corners = np.array([corner["position_m"] for corner in truth["corners"]])
    assert np.allclose(made.centre_m, corners.mean(axis=0))
    key = described["key"]
    parts = BUILDERS["mug"](stream(key, "redrawn1.object2", "mug"), 0.1)
    item = {
        "object_id": FIRST_OBJECT_ID + 2,
        "builder": "mug",
        "height_m": 0.1,
        "triangles": sum(len(part.triangles) for part in parts),
        "world_from_object": np.eye(4)[:3].tolist(),
    }
    described["objects"] = [item]
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "scene.json").write_text(json.dumps(described))
    (thing,) = Scenery.read(tmp_path / "other").things
    assert [part.name for part in thing.parts] == [part.name for part in parts]
    item["triangles"] += 1
    (tmp_path / "other" / "scene.json").write_text(json.dumps(described))
    with pytest.raises(SceneError, match="render the dataset again"):
        Scenery.read(tmp_path / "other")
    (tmp_path / "other" / "scene.json").write_text('{"target": 7}')
    with pytest.raises(SceneError, match=r"scene\.json"):
        Scenery.read(tmp_path / "other")


def test_true_grasps_begin_with_the_least_occluded_face_and_its_shorter_side(tiny: Path):
    truth = json.loads((tiny / "two" / "truth.json").read_text())
    first, second, *_ = true_grasps(truth)
    best = max(truth["faces"], key=lambda face: face["visible_fraction"])
    assert np.allclose(first.point_m, best["centre_m"])
    assert first.opening_m == pytest.approx(min(best["extent_m"]))
    assert abs(first.jaw @ second.jaw) < 1e-9 and abs(first.jaw @ first.approach) < 1e-9


def test_outcomes_are_there_for_these_grasps_alone_and_the_same_again(tiny: Path, tmp_path: Path):
    truth = json.loads((tiny / "two" / "truth.json").read_text())
    told = tuple(
        {
            "point_m": grasp.point_m.tolist(),
            "approach": grasp.approach.tolist(),
            "jaw": grasp.jaw.tolist(),
            "opening_m": grasp.opening_m,
        }
        for grasp in true_grasps(truth)
    )
    task = SceneTask("two", tiny, tmp_path, gripper(), robot(), told)
    assert not task.is_done()
    came = carry_out(task)
    assert came["grasps"] == len(told) and came["succeeded"] >= 1
    assert task.is_done()
    before = task.path.read_bytes()
    assert json.loads(before)["controls"]["best"]["outcome"] == "success"
    assert json.loads(before)["controls"]["wrong"]["outcome"] != "success"
    carry_out(task)
    assert task.path.read_bytes() == before
    assert not replace(task, grasps=told[:1]).is_done()
    assert not replace(task, gripper=gripper(clearance_m=0.001)).is_done()
    task.path.write_bytes(before[:-9])
    assert not task.is_done()


def test_a_picture_of_a_grasp_shows_gripper_and_target(tiny: Path):
    stage = Stage(tiny, "two", robot("long-arm"), gripper())
    truth = json.loads((tiny / "two" / "truth.json").read_text())
    plans = [stage.planned(grasp, True) for grasp in true_grasps(truth)]
    planned = next(found for found in plans if isinstance(found, Plan))
    place(stage.model, stage.data, planned, planned.there[-1])
    mj.mj_kinematics(stage.model.model, stage.data)
    studio = Studio(tiny / "two", stage, planned)
    picture = studio.picture(Moment.of("close", stage.data), 1).astype(float)
    red, green, blue = picture.transpose(2, 0, 1)
    assert (red > 2.0 * green).sum() > 200  # the target, and the arm's orange
    assert (np.ptp(picture, axis=2) < 12.0).sum() > 200  # room and steel
    assert blue.min() >= 0.0
