"""The first pose of the camera, with no initial guess."""

from easyhecpp.initialise.sampling import InitialPose, SamplingConfig, sample_initial_pose

__all__ = ["InitialPose", "SamplingConfig", "sample_initial_pose"]
