"""Grasps in physics: what goes wrong is called what it is."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import ConvexHull, Delaunay

from cornergrasps import attempts
from cornergrasps import model as physics
from cornergrasps.attempts import SceneTask, Stage, carry_out, true_grasps
from cornergrasps.clutter import CELL_M, THICKNESS_M, pieces
from cornergrasps.engine import Data, mj
from cornergrasps.execute import Result, execute
from cornergrasps.grasp import Grasp
from cornergrasps.model import build
from cornergrasps.plan import Plan, place, plan
from cornergrasps.recipes import Gripper, Robot
from cornergrasps.scenery import SceneError, Scenery
from cornergrasps.strip import Moment, Studio
from cornerscenes.camera import looking_at, standing
from cornerscenes.objects import BUILDERS
from cornerscenes.scene import FIRST_OBJECT_ID
from cornerscenes.shape import Part
from cornerscenes.streams import stream
from cornerscenes.tables import RecipeError, known, read
from tests.grasping import (
    SCENES,
    SIZE,
    UP,
    board,
    carried_out,
    from_above,
    from_the_front,
    gripper,
    moved,
    outcome,
    robot,
    scenery,
)
from tests.scenes import slab

# One of 2 cm, in the plane z = 0, its front upwards.
SQUARE = 0.01 * np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])


def test_the_true_grasp_is_lifted_and_does_not_move_between_the_jaws():
    found = carried_out(from_above())
    assert isinstance(found, Result)
    assert found.outcome == "success"
    assert found.slip_mm is not None and found.slip_mm < 0.2
    assert found.pushed_mm is not None and found.pushed_mm < 0.5


def test_what_goes_wrong_is_called_what_it_is():
    jaws = from_above().jaw
    assert outcome(moved(jaws, 0.03)) == "target"  # a finger comes down on it
    assert outcome(moved(-jaws, 0.03)) == "target"
    assert outcome(moved(UP, 0.05)) == "no_contact"  # it closes above it
    assert outcome(moved(-UP, 0.03)) == "target"  # the palm comes down on it
    assert outcome(from_above(0.20)) == "too_wide"
    assert outcome(from_above(), of=gripper(friction=0.01)) in ("dropped", "slipped")
    assert outcome(from_above(), of=gripper(force_n=0.2)) in ("dropped", "slipped")


def test_the_pads_do_not_creep_and_turn_where_the_load_is_too_much(
    monkeypatch: pytest.MonkeyPatch,
):
    """Coulomb's friction holds without any creep, or it does not hold."""
    aside = replace(from_above(), point_m=from_above().point_m + np.array([0.05, 0.0, 0.0]))
    monkeypatch.setattr(physics, "DENSITY_KG_M3", 600.0)
    found = carried_out(aside)
    assert isinstance(found, Result) and found.outcome == "success"
    assert found.slip_mm is not None and found.slip_mm < 0.03
    assert found.slip_deg is not None and found.slip_deg < 0.03
    monkeypatch.setattr(physics, "DENSITY_KG_M3", 1500.0)
    assert outcome(aside) == "slipped"


def test_a_target_that_is_pushed_was_bumped_into_however_lightly():
    level = from_the_front()
    assert outcome(level) == "success"
    deep = replace(level, point_m=level.point_m - 0.035 * level.approach)
    found = carried_out(deep)  # its palm pushes the target, which weighs 100 g, on the floor
    assert isinstance(found, Result) and found.outcome == "target"


def test_jaws_that_do_not_close_so_far_hold_nothing():
    wide = gripper(most_opening_m=0.16, least_opening_m=0.12)
    aside = replace(moved(from_above().jaw, 0.012), opening_m=0.16)
    assert outcome(aside, of=wide) == "no_contact"


def test_what_is_over_the_target_is_in_its_way_up():
    """A robot that knows the target sees it; one that knows the grasp alone drags it along."""
    level = from_the_front()
    above = standing(0.5 * SIZE[0], 0.0, 0.0)
    above[2, 3] = SIZE[2] + 0.03
    roof = replace(board(0.0, 0.0), world_from_object=above)
    made = scenery(roof)
    model = build(made, robot(), gripper())
    data = mj.MjData(model.model)
    assert plan(made, robot(), gripper(), model, data, level, knows_target=True) == "clutter"
    assert isinstance(plan(made, robot(), gripper(), model, data, level), Plan)
    assert outcome(level, roof) == "clutter"


def test_what_is_touched_on_the_way_stops_the_robot():
    made, beside = scenery(), board(0.0, 0.5 * SIZE[1] + 0.015, yaw_rad=0.5 * np.pi)
    model = build(made, robot(), gripper())
    planned = plan(made, robot(), gripper(), model, mj.MjData(model.model), from_above())
    assert isinstance(planned, Plan)
    unknown = build(scenery(beside), robot(), gripper())
    found = execute(unknown, mj.MjData(unknown.model), gripper(), planned)
    assert found.outcome == "clutter"


def test_a_target_that_stands_on_nothing_is_held_until_the_jaws_have_closed():
    made = scenery()
    on_nothing = replace(made, surfaces_m={}, world_from_target=np.copy(made.world_from_target))
    on_nothing.world_from_target[2, 3] = 0.8
    assert on_nothing.is_held and not made.is_held
    grasp = replace(from_above(), point_m=np.array([0.0, 0.0, 0.8 + SIZE[2]]))
    model = build(on_nothing, robot(), gripper())
    data = mj.MjData(model.model)
    held = model.model.equality("held").id
    assert data.eq_active[held] == 1
    assert mj.MjData(build(made, robot(), gripper()).model).eq_active[held] == 0
    planned = plan(on_nothing, robot(), gripper(), model, data, grasp)
    assert isinstance(planned, Plan)
    heights_m: list[float] = []
    found = execute(
        model,
        data,
        gripper(),
        planned,
        lambda phase, data: heights_m.append(data.body("target").xpos[2]),
    )
    assert found.outcome == "success"
    assert heights_m[-1] - heights_m[0] == pytest.approx(0.1, abs=0.005)  # it comes along


def test_within_its_clearance_an_error_along_the_jaws_does_no_harm():
    for by_m in (0.003, -0.003):
        assert outcome(moved(from_above().jaw, by_m)) == "success"
    assert outcome(moved(from_above().jaw, 0.003), of=gripper(clearance_m=0.001)) == "target"


def test_what_is_in_the_way_is_named_and_leaves_give_way():
    beside = board(0.0, 0.5 * SIZE[1] + 0.015, yaw_rad=0.5 * np.pi)
    assert carried_out(from_above(), beside) == "clutter"  # it does not even begin
    assert (
        outcome(from_above(), replace(beside, parts=board(0.0, 0.0, soft=True).parts)) == "success"
    )
    level = from_the_front()
    upright = replace(level, jaw=UP, opening_m=SIZE[2])
    assert outcome(upright) == "ground"  # the lower jaw would be in the floor
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


def test_what_is_held_but_not_lifted_is_no_success(monkeypatch: pytest.MonkeyPatch):
    strong = gripper(force_n=3000.0)
    assert outcome(from_above(), of=strong) == "success"
    monkeypatch.setattr(physics, "DENSITY_KG_M3", 40000.0)  # 67 kg, more than the carriage lifts
    found = carried_out(from_above(), of=strong)
    assert isinstance(found, Result)
    assert found.outcome == "dropped"
    assert found.slip_mm is not None and found.slip_mm < 5.0


def test_a_simulation_that_diverges_is_a_failure_and_not_an_outcome():
    made = scenery()
    model = build(made, robot(), gripper())
    data = mj.MjData(model.model)
    planned = plan(made, robot(), gripper(), model, data, from_above())
    assert isinstance(planned, Plan)

    def explode(phase: str, data: Data) -> None:
        if phase == "lift":
            data.qfrc_applied[:] = 1e15

    found = execute(model, data, gripper(), planned, explode)
    assert found.outcome == "failed"
    assert found.reason is not None and "BADQ" in found.reason
    assert execute(model, data, gripper(), planned).outcome == "success"  # and nothing is left


def test_jaws_along_the_approach_are_turned_across_it():
    camera = looking_at(np.array([-0.5, -0.4, 0.7]), np.zeros(3))
    for approach in (UP, camera[:3, 0], camera[:3, 1]):
        told = approach.tolist()
        grasp = Grasp.of([0.0, 0.0, 0.1], told, told, 0.1, camera)
        assert np.isfinite(grasp.frame).all()
        assert abs(grasp.jaw @ approach) < 1e-12


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
    flat = Part("flat", SQUARE, np.array([[0, 1, 2], [0, 2, 3]]), part.material, smooth=False)
    (sheet,) = pieces((flat,))
    assert sheet[:, 2].max() == 0.0  # its front is where it is, it is thick behind it
    assert ConvexHull(sheet).volume == pytest.approx(4e-4 * THICKNESS_M, rel=1e-6)
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
    assert (thing.obstacle_points_m()[:, 2] < 0.2).all() and len(thing.obstacle_points_m()) > 100
    assert len(board(0.0, 0.0, soft=True).obstacle_points_m()) == 0
    surfaces = described["surfaces"]
    described["surfaces"] = [*surfaces, surfaces[0] | {"name": "stripe"}]
    (tmp_path / "other" / "scene.json").write_text(json.dumps(described))
    assert Scenery.read(tmp_path / "other").surfaces_m.keys() == made.surfaces_m.keys()
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
    for best in (face for face in truth["faces"] if face["visible_fraction"] > 0.0):
        before, best["visible_fraction"] = best["visible_fraction"], 2.0
        assert np.allclose(true_grasps(truth)[0].point_m, best["centre_m"])
        best["visible_fraction"] = before


def test_outcomes_are_there_for_these_grasps_alone_and_the_same_again(
    tiny: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
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
    assert not replace(task, robot=robot("long-arm")).is_done()
    other = tmp_path / "dataset"
    shutil.copytree(tiny / "two", other / "two")
    elsewhere = replace(task, dataset=other)
    assert elsewhere.is_done()
    with (other / "two" / "truth.json").open("a") as file:
        file.write("\n")
    assert not elsewhere.is_done()
    monkeypatch.setattr(attempts, "physics", lambda: {"mujoco": "another"})
    assert not task.is_done()
    monkeypatch.undo()
    assert task.is_done()
    task.path.write_bytes(before[:-9])
    assert not task.is_done()


def test_the_first_control_is_the_true_grasp_of_the_least_occluded_face(tiny: Path):
    truth = json.loads((tiny / "two" / "truth.json").read_text())
    stage = Stage(tiny, "two", robot(), gripper())
    came = [stage.outcome(grasp, knows_target=True) for grasp in true_grasps(truth)]
    assert any(other != came[0] for other in came[1:])
    assert attempts.controls(stage, truth)["least_occluded"] == came[0]


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
