"""The scene as a model of MuJoCo: room, clutter, target, robot and gripper."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from cornergrasps.clutter import pieces
from cornergrasps.engine import Body, CompiledModel, Spec, mj
from cornergrasps.recipes import Arm, Gripper, Robot
from cornergrasps.scenery import Scenery
from cornerscenes.camera import transformed

# Of what the targets are: a rigid foam, so that an arm for half a kilogram lifts the largest.
DENSITY_KG_M3 = 60.0

# Coulomb's coefficient of all but the pads.
FRICTION = 0.5

# How long a step of the simulation is [s].
STEP_S = 0.002

# What is behind the surfaces of the room [m].
_WALL_M = 0.05

# Who touches whom, as bits of MuJoCo's contype and conaffinity: the robot does not touch itself.
_ROOM, _TARGET, _ROBOT = 1, 2, 4

# What a robot can bump into.
Obstacle = Literal["ground", "wall", "clutter", "target"]

# For the contacts of a robot that stands in a bush.
_MEMORY_BYTES = 256 * 1024 * 1024

# How stiff joints are driven [1/s^2]: a place is held as by a critically damped spring.
_STIFFNESS = 20000.0


@dataclass(frozen=True)
class Model:
    """A compiled model, and where in it things are.

    Attributes
    ----------
    model : CompiledModel
        The model.
    room : dict[int, str]
        Of each geometry that is neither target nor robot what touching it is called: "ground",
        "wall" or "clutter".
    robot : frozenset[int]
        The geometries of arm and gripper; the pads are among them.
    fingers : tuple[frozenset[int], frozenset[int]]
        Those of the two fingers.
    hand : frozenset[int]
        Those of fingers and palm.
    target : int
        The target's geometry.
    joints : int
        How many joints carry the gripper.
    """

    model: CompiledModel
    room: dict[int, Obstacle]
    robot: frozenset[int]
    fingers: tuple[frozenset[int], frozenset[int]]
    hand: frozenset[int]
    target: int
    joints: int

    def touched(self, geometries: tuple[int, int]) -> Obstacle | None:
        """Return what of the room a robot touches, or its arm the target; `None` of all else."""
        one, other = (int(geometry) for geometry in geometries)
        own, other = (one, other) if one in self.robot else (other, one)
        if own not in self.robot:
            return None
        if other == self.target:
            return None if own in self.hand else "target"
        return self.room.get(other)

    def target_touches(self, geometries: tuple[int, int]) -> Obstacle | None:
        """Return what of the room the target touches."""
        pair = {int(geometry) for geometry in geometries}
        return self.room.get((pair - {self.target}).pop()) if self.target in pair else None


def build(scenery: Scenery, robot: Robot, gripper: Gripper) -> Model:
    """Return the model of a scene with a robot whose place is still to be chosen."""
    spec = mj.MjSpec()
    spec.compiler.degree = False
    spec.memory = _MEMORY_BYTES
    spec.option.timestep = STEP_S
    spec.option.integrator = mj.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mj.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 20.0  # friction that does not creep
    spec.option.noslip_iterations = 3
    spec.default.geom.solref = [2.0 * STEP_S, 1.0]  # as hard as the steps allow
    names = _room(spec, scenery)
    _target(spec, scenery)
    joints = _robot(spec, robot, gripper)
    model = spec.compile()
    room: dict[int, Obstacle] = {model.geom(name).id: called for name, called in names.items()}
    left, right = (
        frozenset({model.geom(f"{side} pad").id, model.geom(f"{side} finger").id})
        for side in ("left", "right")
    )
    target = model.geom("target").id
    own = frozenset(range(model.ngeom)) - set(room) - {target}
    hand = left | right | {model.geom("palm").id}
    return Model(model, room, own, (left, right), hand, target, joints)


def _room(spec: Spec, scenery: Scenery) -> dict[str, Obstacle]:
    """Add floor, walls and clutter; return what touching each of them is called."""
    world = spec.worldbody
    names: dict[str, Obstacle] = {}
    touched = {"contype": _ROOM, "conaffinity": 0, "friction": [FRICTION, 0.005, 0.0001]}
    surfaces = scenery.surfaces_m or {"floor": _floor_below(scenery)}
    for name, (first, second, third, fourth) in surfaces.items():
        normal = np.cross(second - first, fourth - first)
        normal /= np.linalg.norm(normal)
        axes = np.stack([(second - first), (fourth - first)])
        sides = np.linalg.norm(axes, axis=1)
        turn = np.column_stack([axes[0] / sides[0], axes[1] / sides[1], normal])
        world.add_geom(
            name=name,
            type=mj.mjtGeom.mjGEOM_BOX,
            size=[*(0.5 * sides + _WALL_M), 0.5 * _WALL_M],
            pos=0.5 * (first + third) - 0.5 * _WALL_M * normal,
            quat=quaternion(turn),
            **touched,
        )
        names[name] = "ground" if name == "floor" else "wall"
    for thing in scenery.things:
        for index, points in enumerate(pieces(thing.parts)):
            name = f"{thing.name} {index}"
            mesh = spec.add_mesh(name=name, inertia=mj.mjtMeshInertia.mjMESH_INERTIA_SHELL)
            mesh.uservert = transformed(thing.world_from_object, points).ravel()
            world.add_geom(name=name, type=mj.mjtGeom.mjGEOM_MESH, meshname=name, **touched)
            names[name] = "clutter"
    return names


def _floor_below(scenery: Scenery) -> Float[np.ndarray, "4 3"]:
    """Return a floor at z = 0 for a scene that has none: the robot must stand somewhere."""
    x, y, _ = scenery.centre_m
    return np.array([[x + a, y + b, 0.0] for a, b in ((-2, -2), (2, -2), (2, 2), (-2, 2))])


def _target(spec: Spec, scenery: Scenery) -> None:
    body = spec.worldbody.add_body(
        name="target",
        pos=scenery.centre_m,
        quat=quaternion(scenery.world_from_target[:3, :3]),
    )
    body.add_freejoint(name="target")
    body.add_geom(
        name="target",
        type=mj.mjtGeom.mjGEOM_BOX,
        size=0.5 * scenery.size_m,
        density=DENSITY_KG_M3,
        contype=_TARGET,
        conaffinity=_ROOM | _ROBOT,
        friction=[FRICTION, 0.005, 0.0001],
    )
    spec.add_equality(
        name="held",
        type=mj.mjtEq.mjEQ_WELD,
        objtype=mj.mjtObj.mjOBJ_BODY,
        name1="target",
        name2="world",
        data=[0.0] * 10 + [1.0, 0.0],  # as it is, turned as stiffly as moved
        solref=[2.0 * STEP_S, 1.0],
        active=scenery.is_held,
    )


def _robot(spec: Spec, robot: Robot, gripper: Gripper) -> int:
    """Add the robot; return how many joints carry the gripper."""
    root = spec.worldbody.add_body(name="root", mocap=True)
    if robot.arm is None:
        hand, count = _carriage(spec, root, gripper), 3
    else:
        hand, count = _arm(spec, root, robot.arm, gripper), 5
    _hand(spec, hand, gripper)
    return count


def _carriage(spec: Spec, root: Body, gripper: Gripper) -> Body:
    """Add three straight joints, along the axes of the gripper's frame."""
    hand = root.add_body(name="hand", gravcomp=1.0)
    for axis in range(3):
        name = "xyz"[axis]
        hand.add_joint(
            name=name,
            type=mj.mjtJoint.mjJNT_SLIDE,
            axis=np.eye(3)[axis],
        )
        _drive(spec, name, gripper.mass_kg + 1.0, 400.0)
    return hand


def _arm(spec: Spec, root: Body, arm: Arm, gripper: Gripper) -> Body:
    """Add the five links; the root's frame is the first axis, on the floor, forwards along x."""
    up = np.array([0.0, 0.0, 1.0])
    places = [
        arm.base_m[1] * up,
        np.array([arm.shoulder_m[0], 0.0, arm.shoulder_m[1]]),
        arm.upper_arm_m * up,
        arm.forearm_m * up,
        arm.wrist_m * up,
    ]
    axes = [up, np.array([0.0, 1.0, 0.0])] * 1 + [np.array([0.0, 1.0, 0.0])] * 2 + [up]
    lengths = [None, arm.upper_arm_m, arm.forearm_m, arm.wrist_m, None]
    body = root
    # What each joint has to turn is bounded by all beyond it, stretched out.
    reach = [arm.upper_arm_m + arm.forearm_m + arm.wrist_m, arm.upper_arm_m + arm.forearm_m]
    reach = [reach[0], reach[0], arm.forearm_m + arm.wrist_m, arm.wrist_m, 0.05]
    for index, (place, axis) in enumerate(zip(places, axes, strict=True)):
        name = f"joint {index + 1}"
        body = body.add_body(name=f"link {index + 1}", pos=place, gravcomp=1.0)
        low, high = np.radians(arm.limits_deg[index])
        body.add_joint(
            name=name,
            type=mj.mjtJoint.mjJNT_HINGE,
            axis=axis,
            limited=mj.mjtLimited.mjLIMITED_TRUE,
            range=[low, high],
            armature=0.01,
        )
        length = lengths[index]
        shape = {
            "name": f"link {index + 1}",
            "mass": arm.mass_kg[index],
            "contype": _ROBOT,
            "conaffinity": _ROOM,
        }
        if length is None:
            body.add_geom(type=mj.mjtGeom.mjGEOM_SPHERE, size=[arm.radius_m, 0.0, 0.0], **shape)
        else:
            body.add_geom(
                type=mj.mjtGeom.mjGEOM_CAPSULE,
                fromto=[0.0, 0.0, 0.0, 0.0, 0.0, length],
                size=[arm.radius_m, 0.0, 0.0],
                **shape,
            )
        beyond = gripper.mass_kg + 0.3 + sum(arm.mass_kg[index:])
        _drive(spec, name, beyond * reach[index] ** 2 + 0.02, arm.torque_nm[index])
    # At 0 the jaws move sideways; the hand's origin is the face, so far beyond the flange.
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    return body.add_body(
        name="hand", pos=[0.0, 0.0, reach_m(gripper)], quat=quaternion(turn), gravcomp=1.0
    )


def reach_m(gripper: Gripper) -> float:
    """Return how far the grasped face is from what the gripper is screwed to [m]."""
    return gripper.palm_m[2] + gripper.finger_m[2] - gripper.depth_m


def _drive(spec: Spec, joint: str, inertia: float, most: float) -> None:
    """Add a motor that holds a joint where it is told to be."""
    spec.add_actuator(
        name=joint,
        trntype=mj.mjtTrn.mjTRN_JOINT,
        target=joint,
        gaintype=mj.mjtGain.mjGAIN_FIXED,
        gainprm=[_STIFFNESS * inertia] + [0.0] * 9,
        biastype=mj.mjtBias.mjBIAS_AFFINE,
        biasprm=[0.0, -_STIFFNESS * inertia, -2.0 * np.sqrt(_STIFFNESS) * inertia] + [0.0] * 7,
        forcelimited=mj.mjtLimited.mjLIMITED_TRUE,
        forcerange=[-most, most],
    )


def _hand(spec: Spec, hand: Body, gripper: Gripper) -> None:
    """Add palm and fingers: x along the jaws, z the way it comes, the origin on the face."""
    robot = {"contype": _ROBOT, "conaffinity": _ROOM, "friction": [FRICTION, 0.005, 0.0001]}
    thickness, width, length = gripper.finger_m
    pad_width, pad_length = gripper.pad_m
    back = gripper.depth_m - length
    hand.add_geom(
        name="palm",
        type=mj.mjtGeom.mjGEOM_BOX,
        size=[0.5 * side for side in gripper.palm_m],
        pos=[0.0, 0.0, back - 0.5 * gripper.palm_m[2]],
        mass=0.7 * gripper.mass_kg,
        **robot,
    )
    half = 0.5 * gripper.most_opening_m
    for side, sign in (("left", -1.0), ("right", 1.0)):
        finger = hand.add_body(name=f"{side} finger", gravcomp=1.0)
        finger.add_joint(
            name=side,
            type=mj.mjtJoint.mjJNT_SLIDE,
            axis=[sign, 0.0, 0.0],
            limited=mj.mjtLimited.mjLIMITED_TRUE,
            range=[0.5 * gripper.least_opening_m, half + 1e-4],
            damping=20.0,
            armature=0.5,
        )
        pad_thickness = 0.002
        finger.add_geom(
            name=f"{side} finger",
            type=mj.mjtGeom.mjGEOM_BOX,
            size=[0.5 * (thickness - pad_thickness), 0.5 * width, 0.5 * length],
            pos=[
                sign * (pad_thickness + 0.5 * (thickness - pad_thickness)),
                0.0,
                back + 0.5 * length,
            ],
            mass=0.15 * gripper.mass_kg,
            **robot,
        )
        finger.add_geom(
            name=f"{side} pad",
            type=mj.mjtGeom.mjGEOM_BOX,
            size=[0.5 * pad_thickness, 0.5 * pad_width, 0.5 * pad_length],
            pos=[sign * 0.5 * pad_thickness, 0.0, gripper.depth_m - 0.5 * pad_length],
            mass=0.001,
            contype=_ROBOT,
            conaffinity=_ROOM,
            friction=[gripper.friction, 0.005, 0.0001],
            condim=4,
            priority=1,
        )
    # One motor moves both alike.
    spec.add_equality(
        name="alike",
        type=mj.mjtEq.mjEQ_JOINT,
        objtype=mj.mjtObj.mjOBJ_JOINT,
        name1="left",
        name2="right",
        data=[0.0, 1.0] + [0.0] * 10,
        solref=[2.0 * STEP_S, 1.0],
    )
    _drive(spec, "left", 1.0 + 0.3 * gripper.mass_kg, 2.0 * gripper.force_n)


def quaternion(turn: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "4"]:
    """Return the unit quaternion (w, x, y, z) of a rotation matrix."""
    found = np.zeros(4)
    mj.mju_mat2Quat(found, np.ascontiguousarray(turn).ravel())
    return found
