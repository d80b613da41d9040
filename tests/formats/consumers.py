"""The exported formats read back the way their consumers read them, by code that is not ours.

Where the consumer is a Python package it is used; else the reader below follows its source:
`static_transform_broadcaster_program.cpp` of geometry2 (ROS 1 and 2), `handeye_calibration.py` of
easy_handeye and easy_handeye2 with rosidl's `set_message_fields`, `calibration_utils.py` of DROID.
Each reader returns the parent, the child and the pose of the child in the parent, in the axes that
the consumer means.
"""

from __future__ import annotations

import json
import re
import runpy
import shlex
import sys
import types
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

Read = tuple[str, str, np.ndarray]


def from_quat_xyzw(xyz: Sequence[float], quat: Sequence[float]) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3] = Rotation.from_quat(np.asarray(quat, dtype=float)).as_matrix()
    T[:3, 3] = xyz
    return T


def from_quat_wxyz(xyz: Sequence[float], quat: Sequence[float]) -> np.ndarray:
    return from_quat_xyzw(xyz, [*quat[1:], quat[0]])


# ROS ----------------------------------------------------------------------------------------------


def tf2_static_transform_publisher(arguments: Sequence[str]) -> Read:
    """The flags as ROS 2's program reads them: pairs in any order, nothing else besides."""
    values = {"--x": 0.0, "--y": 0.0, "--z": 0.0, "--qx": 0.0, "--qy": 0.0, "--qz": 0.0}
    values["--qw"] = 1.0
    frames: dict[str, str] = {}
    pairs = iter(arguments)
    for flag in pairs:
        value = next(pairs)
        if flag in values:
            values[flag] = float(value)
        elif flag in ("--frame-id", "--child-frame-id"):
            frames[flag] = value
        else:
            raise ValueError(f"Extra unparsed arguments on command-line: {flag}")
    quat = [values[flag] for flag in ("--qx", "--qy", "--qz", "--qw")]
    xyz = [values[flag] for flag in ("--x", "--y", "--z")]
    return frames["--frame-id"], frames["--child-frame-id"], from_quat_xyzw(xyz, quat)


def command_line(path: Path) -> list[str]:
    """The words of a shell script's only command, by the rules of a POSIX shell."""
    words = shlex.split(path.read_text(), comments=True)
    assert words.pop(0) == "exec"
    return words


def read_ros2(path: Path) -> Read:
    words = command_line(path)
    assert words[:4] == ["ros2", "run", "tf2_ros", "static_transform_publisher"]
    return tf2_static_transform_publisher(words[4:])


def read_ros2_launch(path: Path) -> Read:
    """Run the launch file against stand-ins for launch's classes, as `ros2 launch` would."""

    class Node:
        def __init__(self, **options: Any) -> None:
            self.options = options

    class LaunchDescription:
        def __init__(self, entities: list[Node]) -> None:
            self.entities = entities

    modules = {
        "launch": types.SimpleNamespace(LaunchDescription=LaunchDescription),
        "launch_ros": types.SimpleNamespace(),
        "launch_ros.actions": types.SimpleNamespace(Node=Node),
    }
    with stand_ins(modules):
        (node,) = runpy.run_path(str(path))["generate_launch_description"]().entities
    assert node.options["package"] == "tf2_ros"
    assert node.options["executable"] == "static_transform_publisher"
    assert re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", node.options["name"])
    return tf2_static_transform_publisher(node.options["arguments"])


def read_ros1(path: Path) -> Read:
    words = command_line(path)
    assert words[:3] == ["rosrun", "tf2_ros", "static_transform_publisher"]
    assert len(words) == 12  # nine arguments: the form with a quaternion
    values = [float(word) for word in words[3:10]]
    return words[10], words[11], from_quat_xyzw(values[:3], values[3:])


class stand_ins:  # noqa: N801
    """Modules that are importable inside the block only."""

    def __init__(self, modules: dict[str, Any]) -> None:
        self.modules = modules

    def __enter__(self) -> None:
        self.before = {name: sys.modules.get(name) for name in self.modules}
        sys.modules.update(self.modules)

    def __exit__(self, *_: object) -> None:
        for name, module in self.before.items():
            if module is None:
                del sys.modules[name]
            else:
                sys.modules[name] = module


# easy_handeye -------------------------------------------------------------------------------------


@dataclass
class Vector3:
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0


@dataclass
class Quaternion:
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    w: float = 1.0


@dataclass
class RosTransform:
    translation: Vector3 = field(default_factory=Vector3)
    rotation: Quaternion = field(default_factory=Quaternion)


@dataclass
class HandeyeCalibrationParameters:
    name: str = ""
    calibration_type: str = ""
    robot_base_frame: str = ""
    robot_effector_frame: str = ""
    tracking_base_frame: str = ""
    tracking_marker_frame: str = ""
    freehand_robot_movement: bool = False
    move_group_namespace: str = "/"
    move_group: str = "manipulator"


@dataclass
class HandeyeCalibration:
    parameters: HandeyeCalibrationParameters = field(default_factory=HandeyeCalibrationParameters)
    transform: RosTransform = field(default_factory=RosTransform)


def set_message_fields(message: Any, values: dict[str, Any]) -> None:
    for name, value in values.items():
        here = getattr(message, name)  # AttributeError on an unknown field, as in rosidl
        if hasattr(here, "__dataclass_fields__"):
            set_message_fields(here, value)
        else:
            assert type(value) is type(here), f"{name} is {type(value)}"
            setattr(message, name, value)


def read_easy_handeye2(path: Path) -> Read:
    message = HandeyeCalibration()
    set_message_fields(message, yaml.full_load(path.read_text()))
    parameters = message.parameters
    assert path.name == f"{parameters.name}.calib"
    in_hand = parameters.calibration_type == "eye_in_hand"
    assert in_hand or parameters.calibration_type == "eye_on_base"
    parent = parameters.robot_effector_frame if in_hand else parameters.robot_base_frame
    t, r = message.transform.translation, message.transform.rotation
    T = from_quat_xyzw([t.x, t.y, t.z], [r.x, r.y, r.z, r.w])
    return parent, parameters.tracking_base_frame, T


def read_easy_handeye(path: Path) -> Read:
    def parameters(  # the constructor's arguments: any other key is an error
        *,
        namespace: str,
        eye_on_hand: bool,
        robot_base_frame: str,
        robot_effector_frame: str,
        tracking_base_frame: str,
        tracking_marker_frame: str,
        move_group_namespace: str = "/",
        move_group: str = "manipulator",
        freehand_robot_movement: bool | None = None,
    ) -> Read:
        # publish.launch: namespace = prefix + _eye_on_hand or _eye_on_base
        assert namespace.endswith("_eye_on_hand/" if eye_on_hand else "_eye_on_base/")
        parent = robot_effector_frame if eye_on_hand else robot_base_frame
        t = data["transformation"]
        T = from_quat_xyzw([t["x"], t["y"], t["z"]], [t["qx"], t["qy"], t["qz"], t["qw"]])
        return parent, tracking_base_frame, T

    data = yaml.safe_load(path.read_text())
    return parameters(**data["parameters"])


# Robot descriptions -------------------------------------------------------------------------------


def whole_urdf(path: Path) -> str:
    """Include the exported xacro in a robot's, as a user would, and expand it."""
    import xacro

    parent = re.search(r"<parent link=(['\"])(.*?)\1", path.read_text())
    assert parent is not None
    robot = path.with_name("robot.urdf.xacro")
    robot.write_text(
        f"""<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">
          <link name="{parent[2]}"/>
          <xacro:include filename="{path}"/>
        </robot>"""
    )
    return xacro.process_file(str(robot)).toxml()


def read_urdf_with_yourdfpy(path: Path) -> Read:
    import io

    import yourdfpy

    robot = yourdfpy.URDF.load(io.BytesIO(whole_urdf(path).encode()), load_meshes=False)
    (joint,) = robot.robot.joints
    assert joint.type == "fixed"
    return joint.parent, joint.child, robot.get_transform(joint.child, joint.parent)


def read_urdf_with_pinocchio(path: Path) -> Read:
    import pinocchio

    model = pinocchio.buildModelFromXML(whole_urdf(path))
    data = model.createData()
    pinocchio.framesForwardKinematics(model, data, np.zeros(model.nq))
    child = model.frames[-1]
    parent = model.frames[child.parentFrame]
    while parent.type != pinocchio.FrameType.BODY:
        parent = model.frames[parent.parentFrame]
    poses = [data.oMf[model.getFrameId(name)].homogeneous for name in (parent.name, child.name)]
    return parent.name, child.name, np.linalg.inv(poses[0]) @ poses[1]


# Matrices -----------------------------------------------------------------------------------------


def read_json(path: Path) -> Read:
    data = json.loads(path.read_text())
    return data["parent_frame"], data["child_frame"], np.array(data["cam2world_gl"])


def read_json_extrinsic(path: Path) -> Read:
    data = json.loads(path.read_text())
    T = np.linalg.inv(np.vstack([data["extrinsic_cv"], [0.0, 0.0, 0.0, 1.0]]))
    return data["parent_frame"], data["child_frame"], T


def read_opengl(path: Path) -> Read:
    data = json.loads(path.read_text())
    T = np.linalg.inv(np.array(data["world2cam_gl"]))
    np.testing.assert_allclose(from_quat_wxyz(data["xyz_m"], data["quat_wxyz"]), T, atol=1e-12)
    np.testing.assert_allclose(from_quat_xyzw(data["xyz_m"], data["quat_xyzw"]), T, atol=1e-12)
    return data["parent_frame"], data["child_frame"], T


def read_npz(path: Path) -> Read:
    with np.load(path, allow_pickle=False) as data:
        T = np.linalg.inv(np.vstack([data["extrinsic_cv"], [0.0, 0.0, 0.0, 1.0]]))
        return str(data["parent_frame"]), str(data["child_frame"]), T


def read_npy(path: Path) -> Read:
    words = path.with_name(path.name + ".txt").read_text()
    parent = re.search(r"^parent frame: (.*)$", words, re.MULTILINE)
    child = re.search(r"^child frame: (.*?);", words, re.MULTILINE)
    assert parent is not None
    assert child is not None
    return parent[1], child[1], np.load(path, allow_pickle=False)


def read_droid(path: Path) -> Read:
    calibration = json.loads(path.read_text())
    poses = {key: data["pose"] for key, data in calibration.items()}
    ((key, pose),) = poses.items()
    assert key.endswith("_left")
    assert calibration[key]["timestamp"] > 1.7e9
    T = np.eye(4)
    T[:3, 3] = pose[:3]
    T[:3, :3] = Rotation.from_euler("xyz", pose[3:]).as_matrix()
    return calibration[key]["parent_frame"], calibration[key]["child_frame"], T


# Simulators ---------------------------------------------------------------------------------------


def mujoco_model(path: Path) -> Any:
    """The camera included in a body that stands somewhere, as a user would do it."""
    import mujoco

    return mujoco.MjModel.from_xml_string(
        f"""<mujoco><worldbody><body name="mount" pos="0.3 -0.2 0.5" euler="10 20 30">
        <include file="{path}"/></body></worldbody></mujoco>"""
    )


def read_mujoco(path: Path) -> Read:
    import mujoco

    model = mujoco_model(path)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    poses = []
    for xpos, xmat in (
        (data.body("mount").xpos, data.body("mount").xmat),
        (data.cam(0).xpos, data.cam(0).xmat),
    ):
        T = np.eye(4)
        T[:3, :3] = xmat.reshape(3, 3)
        T[:3, 3] = xpos
        poses.append(T)
    parent = re.search(r"parent frame: (.*)$", path.read_text(), re.MULTILINE)
    assert parent is not None
    return parent[1], model.cam(0).name, np.linalg.inv(poses[0]) @ poses[1]


def usd_camera(path: Path) -> Any:
    from pxr import Usd, UsdGeom

    stage = Usd.Stage.Open(str(path))
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    assert UsdGeom.GetStageUpAxis(stage) == "Z"
    (prim,) = stage.GetDefaultPrim().GetChildren()
    # The stage goes along since its prims end with it.
    return UsdGeom.Camera(prim), stage


def read_usd(path: Path) -> Read:
    from pxr import UsdGeom

    camera, _stage = usd_camera(path)
    prim = camera.GetPrim()
    matrix = UsdGeom.Xformable(prim).GetLocalTransformation()
    frames = [p.GetCustomDataByKey("frame") for p in (prim.GetParent(), prim)]
    return frames[0], frames[1], np.array(matrix).T  # USD multiplies row vectors


def read_isaaclab(convention: str, order: str) -> Any:
    def read(path: Path) -> Read:
        values = runpy.run_path(str(path))
        rotation = values[f"ROT_{order.upper()}"][convention]
        build = from_quat_wxyz if order == "wxyz" else from_quat_xyzw
        return values["PARENT_FRAME"], values["CHILD_FRAME"], build(values["POS"], rotation)

    return read


def sapien_values(path: Path) -> dict[str, Any]:
    class Pose:
        def __init__(self, p: Sequence[float], q: Sequence[float]) -> None:
            self.T = from_quat_wxyz(p, q)

    with stand_ins({"sapien": types.SimpleNamespace(Pose=Pose)}):
        return runpy.run_path(str(path))


def read_sapien(path: Path) -> Read:
    values = sapien_values(path)
    return values["PARENT_FRAME"], values["CHILD_FRAME"], values["POSE"].T
