"""``python -m sb3_hucrl.zoo train ...`` is ``rl_zoo3 train ...`` with the plug-in loaded."""

from __future__ import annotations

from collections.abc import Callable

from rl_zoo3 import cli

main: Callable[[], None] = cli.main

if __name__ == "__main__":
    main()
