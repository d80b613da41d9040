"""Find the camera of a capture folder: three nouns and one verb.

python examples/01_calibrate_a_capture.py ../shared/captures/xarm7_realsense
"""

import sys
from pathlib import Path

from easyhecpp import Camera, Capture, Robot, calibrate

folder = Path(sys.argv[1])

# A capture is a robot, a camera, and views of the one through the other.
capture = Capture.load(folder)
robot: Robot = capture.robot
camera: Camera = capture.camera
print(f"{robot.name}: {robot.n_joints} joints, {robot.n_faces} triangles")
print(f"{camera.width}x{camera.height} pixels, {len(capture.views)} views")

# No initial guess: masks, first pose and optimisation are found from the capture alone.
found = calibrate(capture)

result = found.result
print(f"verdict: {result.verdict}", *result.reasons, sep="\n  ")
print(f"camera in {result.T_mount_cam.parent}, metres:", result.T_mount_cam.xyz_m)
print(f"standard deviation: {result.sigma.position_mm:.2f} mm, {result.sigma.rotation_deg:.3f} deg")

# result.json is what every exporter, the report and the comparison read.
result.write(Path("result.json"))
