"""Trained policies for the real system: without hallucinated actions, and without this package."""

from sb3_hucrl.deployment.export import export

__all__ = ["export"]
