"""The README's code works as the README says."""

import re
from pathlib import Path
from typing import Any

import pytest

from sb3_hucrl import ImaginationVecEnv

pytestmark = pytest.mark.slow

README = (Path(__file__).parent.parent / "README.md").read_text()
SNIPPETS = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)


def test_the_three_line_change_runs() -> None:
    [snippet] = SNIPPETS
    # Shorter, so that the test takes seconds; nothing else is changed.
    short = snippet.replace("128_000", "640").replace("HUCRLCallback()", "HUCRLCallback(imagined_steps=320)")
    assert "640" in short
    assert "320" in short
    namespace: dict[str, Any] = {}
    exec(short, namespace)
    model, env = namespace["model"], namespace["env"]
    assert model.hucrl.real_episodes == 3
    assert isinstance(env, ImaginationVecEnv)
    assert env.trajectories is None
