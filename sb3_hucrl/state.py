"""Where files of version 0.1 look for the state of a run; new code imports it from :mod:`sb3_hucrl`."""

from sb3_hucrl.loop.state import HUCRLState

__all__ = ["HUCRLState"]
