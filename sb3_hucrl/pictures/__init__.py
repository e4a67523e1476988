"""Pictures and videos of runs."""

from sb3_hucrl.pictures.phase_space import draw_phase_space
from sb3_hucrl.pictures.progress import draw_progress
from sb3_hucrl.pictures.trajectories import trajectories, transitions
from sb3_hucrl.pictures.video import record_video

__all__ = ["draw_phase_space", "draw_progress", "record_video", "trajectories", "transitions"]
