"""
Runs the doctor before the rest of the package is imported, if Python was started with ``-m sb3_hucrl.doctor``. Python
imports ``sb3_hucrl`` before any module in it, and what is broken may be what that import needs.
"""

from __future__ import annotations

import sys
from itertools import pairwise

if ("-m", "sb3_hucrl.doctor") in pairwise(sys.orig_argv):
    from sb3_hucrl.doctor.__main__ import main

    sys.exit(main())
