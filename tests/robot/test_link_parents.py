"""Which link with geometry hangs on which."""

from __future__ import annotations

from easyhecpp.robot import Robot

BOX = '<visual><geometry><box size="0.1 0.1 0.1"/></geometry></visual>'
# world - base - (flange, bare) - hand - left and right finger
URDF = f"""<robot name="branching">
  <link name="world"/><link name="left">{BOX}</link><link name="right">{BOX}</link>
  <link name="base">{BOX}</link><link name="flange"/><link name="hand">{BOX}</link>
  <joint name="a" type="fixed"><parent link="world"/><child link="base"/></joint>
  <joint name="b" type="continuous"><parent link="base"/><child link="flange"/>
    <axis xyz="0 0 1"/></joint>
  <joint name="c" type="fixed"><parent link="flange"/><child link="hand"/></joint>
  <joint name="d" type="continuous"><parent link="hand"/><child link="left"/>
    <axis xyz="0 0 1"/></joint>
  <joint name="e" type="fixed"><parent link="hand"/><child link="right"/></joint>
</robot>"""


def test_parents_skip_links_without_geometry(tmp_path):
    path = tmp_path / "robot.urdf"
    path.write_text(URDF)
    robot = Robot.from_urdf(path)

    def parents(robot):
        names = robot.link_names
        return {
            name: None if parent < 0 else names[parent]
            for name, parent in zip(names, robot.link_parents, strict=True)
        }

    assert parents(robot) == {"base": None, "hand": "base", "left": "hand", "right": "hand"}
    assert parents(robot.without_links(["hand"])) == {"base": None, "left": "base", "right": "base"}
