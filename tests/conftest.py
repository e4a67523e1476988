"""Settings for all tests, made before PyTorch is imported."""

import os

# Tests run side by side: with a thread pool each they would wait for each other. Child processes inherit this.
os.environ.setdefault("OMP_NUM_THREADS", "1")
