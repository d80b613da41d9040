"""Robot arms by name, from the URDFs and meshes of the example-robot-data wheel, or by file."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from importlib import metadata
from pathlib import Path

from easyhecpp.capture.write import RobotSource
from easyhecpp.errors import InputError, MissingExtraError
from easyhecpp.robot import Robot
from easyhecpp.robot.robot import check_links

PACKAGE = "example-robot-data"


@dataclass(frozen=True)
class NamedRobot:
    """Where a named arm lies in example-robot-data.

    Attributes:
        urdf: path below the package's ``robots`` folder.
        ee_link: the link that a camera on the wrist is screwed to.
        stands_on: ``table`` for an arm that is bolted down, ``floor`` for one with its own stand.
        base_link: the base frame, or None for the package's usual choice.
        ignore_links: links whose geometry is left out.
        aliases: other names that users try.
    """

    urdf: str
    ee_link: str
    stands_on: str = "table"
    base_link: str | None = None
    ignore_links: tuple[str, ...] = ()
    aliases: tuple[str, ...] = ()


ROBOTS: dict[str, NamedRobot] = {
    "xarm7": NamedRobot("xarm_description/urdf/xarm7.urdf", "link7"),
    "panda": NamedRobot(
        "panda_description/urdf/panda.urdf", "panda_hand", aliases=("franka", "fr3")
    ),
    "ur3": NamedRobot("ur_description/urdf/ur3_robot.urdf", "wrist_3_link"),
    "ur5": NamedRobot("ur_description/urdf/ur5_robot.urdf", "wrist_3_link"),
    "ur10": NamedRobot("ur_description/urdf/ur10_robot.urdf", "wrist_3_link"),
    "baxter": NamedRobot(
        "baxter_description/urdf/baxter.urdf",
        "left_wrist",
        "floor",
        base_link="base",
        # Spheres that only stand for the head in collision checks.
        ignore_links=("collision_head_link_1", "collision_head_link_2"),
    ),
    "kinova_gen2": NamedRobot(
        "kinova_description/robots/kinova.urdf", "j2s6s200_link_6", aliases=("kinova", "jaco")
    ),
    "so100": NamedRobot("so_arm_description/urdf/so100.urdf", "gripper"),
    "so101": NamedRobot("so_arm_description/urdf/so101.urdf", "gripper_link"),
    "z1": NamedRobot("z1_description/urdf/z1.urdf", "link06", aliases=("unitree_z1",)),
    "tiago": NamedRobot("tiago_description/robots/tiago_no_hand.urdf", "arm_7_link", "floor"),
}


def robot_names() -> tuple[str, ...]:
    """Names that `load_robot` takes, without aliases."""
    return tuple(ROBOTS)


def named_robot(name: str) -> NamedRobot:
    """The entry of a named arm; upper case, spaces and hyphens do not matter.

    Raises:
        InputError: nothing is called that; the text lists every name.
    """
    wanted = _plain(name)
    for known, entry in ROBOTS.items():
        if wanted in {_plain(known), *map(_plain, entry.aliases)}:
            return entry
    raise InputError(
        f"There is no built-in robot called {name!r}",
        expected="one of " + ", ".join(ROBOTS),
        fix="For any other robot give the path of its URDF file.",
    )


def is_robot_file(name: str) -> bool:
    """Whether this is the path of a robot's description, not the name of a built-in one."""
    return Path(name).suffix.lower() in {".urdf", ".xacro"}


def robot_source(name: str) -> RobotSource:
    """Where an arm's URDF is, as a capture folder records it.

    Args:
        name: of a built-in arm, or the path of a URDF.

    Raises:
        InputError: unknown name.
        MissingExtraError: the wheel with the URDFs is not installed.
    """
    if is_robot_file(name):
        return RobotSource(Path(name).resolve(), copy=False)
    entry = named_robot(name)
    share = data_folder()
    return RobotSource(
        share / PACKAGE / "robots" / entry.urdf, (share,), entry.ignore_links, copy=False
    )


@lru_cache(maxsize=8)
def load_robot(name: str) -> Robot:
    """Load an arm.

    Args:
        name: of a built-in arm, or the path of a URDF.

    Raises:
        InputError: unknown name, or anything wrong with the file.
        MissingExtraError: the wheel with the URDFs is not installed.
    """
    source = robot_source(name)
    if is_robot_file(name):
        return Robot.from_urdf(source.path)
    return Robot.from_urdf(
        source.path,
        package_dirs=source.package_dirs,
        base_link=named_robot(name).base_link,
        ignore_links=source.ignore_links,
    )


def end_link(name: str, wanted: str | None = None) -> str:
    """The link at the end of an arm.

    Args:
        name: of a built-in arm, or the path of a URDF.
        wanted: the link to take; by default the one that is known of a built-in arm, or for a file
            the last link of its longest chain, the first of several in the order of the file.

    Raises:
        InputError: unknown name or link, or anything wrong with the file.
        MissingExtraError: the wheel with the URDFs is not installed.
    """
    if wanted is not None:
        check_links([wanted], load_robot(name).frame_names, "the link at the arm's end")
        return wanted
    if not is_robot_file(name):
        return named_robot(name).ee_link
    robot = load_robot(name)
    lengths = [_links_above(robot, frame) for frame in range(len(robot.frame_names))]
    return robot.frame_names[lengths.index(max(lengths))]


@lru_cache(maxsize=1)
def data_folder() -> Path:
    """The folder that holds the package ``example-robot-data`` (it is not a Python module).

    Raises:
        MissingExtraError: the wheel is not installed.
    """
    try:
        files = metadata.files(PACKAGE) or ()
    except metadata.PackageNotFoundError as error:
        raise MissingExtraError(PACKAGE, "sim", "A robot by name") from error
    for file in files:
        if file.parts[-2:] == (PACKAGE, "package.xml"):
            return Path(str(file.locate())).resolve().parents[1]
    raise MissingExtraError(PACKAGE, "sim", "A robot by name", reason="its robots are missing")


def _links_above(robot: Robot, frame: int) -> int:
    above = int(robot.tree.frames_above[frame])
    return 0 if above < 0 else 1 + _links_above(robot, above)


def _plain(name: str) -> str:
    return "".join(c for c in name.lower() if c.isalnum())
