"""``python -m sb3_hucrl.zoo train ...`` is ``rl_zoo3 train ...`` with the plug-in loaded."""

from rl_zoo3.cli import main

if __name__ == "__main__":
    main()
