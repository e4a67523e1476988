"""The rl_zoo3 plug-in: importing it registers the environments and their hyperparameters."""

import sb3_hucrl  # noqa: F401  # registers the environments
from sb3_hucrl.zoo.plugin import install

install()
