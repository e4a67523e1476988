"""Policy searches and planning that SB3 has no algorithm for."""

from sb3_hucrl.algorithms.hbptt import HBPTT
from sb3_hucrl.algorithms.hmpc import HMPC
from sb3_hucrl.algorithms.hmpo import HMPO
from sb3_hucrl.algorithms.hmve import HMVE
from sb3_hucrl.algorithms.hsvg import HSVG
from sb3_hucrl.algorithms.mpo import MPO

__all__ = ["HBPTT", "HMPC", "HMPO", "HMVE", "HSVG", "MPO"]
