"""Others' agents drive through Gymnasium's interface."""

import subprocess
import sys
from typing import Any

import gymnasium
import numpy as np
from gymnasium.utils.env_checker import check_env
from world_fixture import result_beside

SMALL = {
    "town_seed": 5, "image_scale": 0.05, "cameras": ("CAM_FRONT",), "duration_s": 4.0,
}  # fmt: skip
ENV = "shoot.simulation.environment:shoot/City-v0"


def checked_env() -> bool:
    check_env(gymnasium.make(ENV, **SMALL).unwrapped, skip_render_check=True)
    return True


def test_gymnasium_finds_nothing_wrong() -> None:
    assert result_beside(checked_env)


def two_episodes() -> dict[str, Any]:
    """Standing; and the same by templates, one of which stands; the other goes on."""
    still, on = np.zeros((20, 2)), np.stack([2.0 * np.arange(1, 21), np.zeros(20)], axis=1)
    plans = gymnasium.make(ENV, mode="replay", **SMALL)
    numbers = gymnasium.make(ENV, mode="replay", templates=np.stack([on, still]), **SMALL)
    seen: dict[str, Any] = {"spaces": (plans.action_space, numbers.action_space)}
    for name, env, action in (
        ("plan", plans, on.astype(np.float32)), ("number", numbers, 0), ("still", numbers, 1),
    ):  # fmt: skip
        first, info = env.reset(seed=3)
        steps = [env.step(action)]
        while not (steps[-1][2] or steps[-1][3]):
            steps.append(env.step(action))
        log = env.unwrapped.log()
        seen[name] = (first, info, steps, log)
    return seen


def test_numbers_of_templates_are_their_plans_and_progress_is_rewarded() -> None:
    seen = result_beside(two_episodes)
    first, info, steps, log = seen["plan"]
    assert info["town_seed"] == 5
    assert first["images"].shape == (1, 45, 80, 3)
    same_first, same_info, same_steps, _ = seen["number"]
    assert info == same_info
    assert first["images"].tobytes() == same_first["images"].tobytes()
    assert len(steps) == len(same_steps)
    for one, same in zip(steps, same_steps, strict=True):
        assert one[0]["images"].tobytes() == same[0]["images"].tobytes()
        assert one[1:4] == same[1:4]
    rewards = [step[1] for step in steps]
    way_m = np.hypot(*np.diff(log.ego.xy_m[20:], axis=0).T).sum()
    assert sum(rewards) > sum(step[1] for step in seen["still"][2]) + 2.0
    assert sum(rewards) <= way_m + 1.0
    assert [step[3] for step in seen["still"][2]] == [False, False, False, True]
    box, discrete = seen["spaces"]
    assert box.shape == (20, 2)
    assert discrete.n == 2


def test_who_does_not_drive_through_it_does_not_load_it() -> None:
    code = "import sys; from shoot.simulation import Simulator; print('gymnasium' in sys.modules)"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "False"
