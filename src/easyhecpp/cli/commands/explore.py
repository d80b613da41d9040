"""``easyhecpp explore``."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from tyro.conf import Positional

from easyhecpp.cli.output import progress, say, say_json

if TYPE_CHECKING:
    from easyhecpp.session.next_poses import NextPoses


@dataclass(frozen=True)
class Explore:
    """Propose the joint poses to take the next pictures at.

    Calibrates the capture, or takes the result.json of it, and chooses the joint poses after which
    the camera will be known best. A capture with robot and intrinsics only gets joint poses to
    begin with. Writes next_joints.csv and a picture of every view to be.
    """

    capture: Positional[Path]
    """Folder of the capture."""

    count: int = 3
    """How many joint poses, each chosen as if the ones before had been taken."""

    method: Literal["information", "consistency", "random"] = "information"
    """information: least expected error of the camera's position; consistency: the paper's way, the
    masks that differ most between possible cameras; random: any that suits."""

    result: Path | None = None
    """A result.json of this capture; the capture is calibrated when left out."""

    target_mm: float | None = None
    """Say when the camera's position is known to this standard deviation, millimetres."""

    floor: float | Literal["foot", "none"] = "foot"
    """Height in metres in the base frame that the moving links stay above: a number, foot for
    where the arm stands, none for anywhere."""

    seed: int = 0
    """Another seed draws other candidates."""

    out: Path | None = None
    """Folder for the table and the pictures; the capture's name with "-next" in the current folder
    when left out."""

    json: bool = False
    """Print everything as JSON instead of a summary."""

    quiet: bool = False
    """No progress on standard error."""

    def run(self, command_line: str) -> int:
        """Choose, write, say why."""
        from easyhecpp.explore import ExploreConfig, Limits
        from easyhecpp.session.next_poses import propose, save_next_poses
        from easyhecpp.session.save import output_folder

        out = self.out or Path(f"{self.capture.resolve().name}-next")
        config = ExploreConfig(
            method=self.method,
            target_position_mm=self.target_mm,
            limits=Limits(floor=None if self.floor == "none" else self.floor),
        )
        with progress(self.quiet) as tell, output_folder(out):
            found = propose(
                self.capture, config, self.count, self.seed, result=self.result, progress=tell
            )
            written = save_next_poses(found, out)
        if self.json:
            say_json({**_as_json(found), "written": [str(path) for path in written]})
        else:
            _summarise(found)
            say(f"written to {out}/")
        return 0


def _summarise(found: NextPoses) -> None:
    for note in dict.fromkeys(found.notes):
        say(f"note: {note}")
    if found.proposals:
        first = found.proposals[0]
        say(
            f"the camera is known to {first.position_mm:.2f} mm and {first.rotation_deg:.3f} deg "
            "(standard deviation)"
        )
        if first.stop:
            say(f"No more views are needed: {first.stop_reason}")
    names = found.rig.robot.joint_names
    types = found.rig.robot.joint_types
    width = max(len(name) for name in names)
    for i, (view, joints) in enumerate(zip(found.ids, found.joints, strict=True)):
        say()
        say(f"{view}:")
        for name, kind, value in zip(names, types, joints, strict=True):
            unit = "m" if kind == "prismatic" else f"rad  {np.rad2deg(value):+9.3f} deg"
            say(f"  {name:{width}}  {value:+9.5f} {unit}")
        if found.proposals:
            p = found.proposals[i]
            say(f"  then: {p.predicted_position_mm:.2f} mm, {p.predicted_rotation_deg:.3f} deg")
            say(f"  {p.reason}")
    rejected = found.proposals[0].rejected if found.proposals else {}
    if rejected:
        say()
        say("not considered: " + ", ".join(f"{n} because {why}" for why, n in rejected.items()))


def _as_json(found: NextPoses) -> dict[str, Any]:
    names = found.rig.robot.joint_names
    views: list[dict[str, Any]] = []
    for i, (view, joints) in enumerate(zip(found.ids, found.joints, strict=True)):
        entry: dict[str, Any] = {
            "view": view,
            "joints": dict(zip(names, joints.tolist(), strict=True)),
        }
        if found.proposals:
            told = asdict(found.proposals[i])
            del told["joints"]
            entry |= told
        views.append(entry)
    return {"views": views, "notes": list(dict.fromkeys(found.notes))}
