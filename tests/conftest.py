"""Settings for all tests, made before PyTorch and MuJoCo are imported."""

import os

# Tests run side by side: with a thread pool each they would wait for each other. Child processes inherit this.
os.environ.setdefault("OMP_NUM_THREADS", "1")
# Frames are drawn without a screen.
os.environ.setdefault("MUJOCO_GL", "egl")
os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
