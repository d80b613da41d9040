"""The real captures, and what counts as the same pose on them."""

CAPTURES = ("xarm7_realsense", "lbr_med7_realsense")
SAME_METRES, SAME_DEGREES = 0.020, 2.0
