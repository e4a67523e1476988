"""What SB3 has no algorithm for."""

from sb3_hucrl.algorithms.hmpc import HMPC

__all__ = ["HMPC"]
