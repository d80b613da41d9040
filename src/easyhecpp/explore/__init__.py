"""Choice of the joint poses that tell most about where the camera is."""

from easyhecpp.explore.candidates import draw_candidates
from easyhecpp.explore.choose import ExploreConfig, choose_many, choose_next
from easyhecpp.explore.consistency import EASYHEC, ConsistencyConfig, consistency_scores
from easyhecpp.explore.feasible import Limits
from easyhecpp.explore.first import first_joint_poses
from easyhecpp.explore.knowledge import METHODS, Knowledge, Method, Proposal
from easyhecpp.explore.protocols import CollisionChecker

__all__ = [
    "EASYHEC",
    "METHODS",
    "CollisionChecker",
    "ConsistencyConfig",
    "ExploreConfig",
    "Knowledge",
    "Limits",
    "Method",
    "Proposal",
    "choose_many",
    "choose_next",
    "consistency_scores",
    "draw_candidates",
    "first_joint_poses",
]
