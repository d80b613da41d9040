"""Collisions of the arm with itself."""

from easyhecpp.planning.self_collision import SelfCollision, best_checker

__all__ = ["SelfCollision", "best_checker"]
