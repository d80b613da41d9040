"""What people look at: overlays, the HTML report and the 3-D viewer.

Nothing is imported here, so that an overlay does not pay for the viewer.
"""
