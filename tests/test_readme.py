"""The README's code does what the README says."""

import re
from pathlib import Path
from typing import Any

from sb3_hucrl import ImaginationVecEnv

README = (Path(__file__).parent.parent / "README.md").read_text()


def test_the_three_line_change_runs() -> None:
    [snippet] = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)
    # Shorter, so that the test takes seconds; nothing else is changed.
    short = snippet.replace("38_400", "640").replace("12_800", "320")
    assert short != snippet
    namespace: dict[str, Any] = {}
    exec(short, namespace)
    model, env = namespace["model"], namespace["env"]
    assert model.hucrl.real_episodes == 3
    assert isinstance(env, ImaginationVecEnv)
    assert env.imagination is None
