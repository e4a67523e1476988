"""Where files of version 0.1 look for the parameters of a policy; new code imports them from :mod:`sb3_hucrl.sb3`."""

from sb3_hucrl.sb3.parameters import Parameters

__all__ = ["Parameters"]
