"""The README's code works as the README says."""

import re
from pathlib import Path
from typing import Any

import pytest

from sb3_hucrl import ImaginationVecEnv
from sb3_hucrl.tasks import check_task

pytestmark = pytest.mark.slow

README = (Path(__file__).parent.parent / "README.md").read_text()
SNIPPETS = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)


def test_the_three_line_change_runs() -> None:
    [snippet, _] = SNIPPETS
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


def test_the_task_of_ones_own_is_a_task() -> None:
    namespace: dict[str, Any] = {"__name__": "my_module"}
    exec(SNIPPETS[1], namespace)
    check_task(namespace["Parking"](), observation_dim=3, action_dim=1)
