"""The loop as a Gymnasium environment, `shoot/City-v0`: others' agents drive, too.

Importing this file registers it, and `gymnasium.make("shoot.simulation.environment:shoot/City-v0")`
imports it.
"""

from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from jaxtyping import Float

from lss_core.config import CAMERAS
from shoot.footprint import (
    EGO_LENGTH_M,
    EGO_WIDTH_M,
    footprint_centres,
    rectangles_overlap,
)
from shoot.simulation.observation import Observation
from shoot.simulation.plan import Plan
from shoot.simulation.route_log import Mode, RouteLog
from shoot.simulation.senses import SensorSettings
from shoot.simulation.simulator import Simulator
from shoot.world.sensing.rig_plans import RIG_PLANS
from shoot.world.town.roads import make_town
from shoot.world.town.town import Town

ENV_ID = "shoot/City-v0"
NUM_POINTS, DT_S = 20, 0.25
REACH_M = 150.0
_MAX_SPEED_MPS, _MAX_PIXELS, _MAX_MOUNT_M = 100.0, 1e5, 10.0
_SEEDS = 2**31

Array = np.ndarray[Any, np.dtype[Any]]
Seen = dict[str, Any]
Action = Array | np.int64 | int


class CityEnv(gymnasium.Env[Seen, Action]):
    """One route after the other, each in a town of its own unless one is named.

    An observation holds `images` [N, H, W, 3], `pixel_from_camera` [N, 3, 3], `ego_from_camera`
    [N, 4, 4] (in `ego` now, each camera at its own shutter's time) and `speed_mps` [1]. An action
    is a plan [20, 2] in metres in `ego`, a point each 0.25 s, or with templates the number of one;
    it is followed for 0.5 s. The reward is the progress along the route in metres meanwhile. An
    episode ends when the ego touches somebody, and is cut off when the route's time is up. The
    same seed gives the same bytes.

    Args:
        town_seed: Of the town; None: another one each time, as the seed of `reset` says.
        mode: Whether traffic answers, see `Simulator`.
        templates: What actions number; None: actions are plans.
        cameras: Channels seen, in this order.
        image_scale: Size of the images as a share of 1600 x 900.
        duration_s: Of a route, of which the rule driver drives the first 2 s.
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012 - as gymnasium has it

    def __init__(
        self,
        town_seed: int | None = None,
        mode: Mode = "reactive",
        templates: Float[Array, "K 20 2"] | None = None,
        cameras: tuple[str, ...] = CAMERAS,
        image_scale: float = 0.25,
        duration_s: float = 20.0,
    ) -> None:
        self._town_seed = town_seed
        self._mode: Mode = mode
        self._duration_s = duration_s
        self._templates = templates
        self._car = SensorSettings(image_scale=image_scale, cameras=cameras)
        self._town: Town | None = None
        self._simulator: Simulator | None = None
        self._place_m = 0.0
        plan = RIG_PLANS[self._car.rig]
        image_hw = round(plan.height_px * image_scale), round(plan.width_px * image_scale)
        num = len(cameras)
        self.action_space = (
            spaces.Box(-REACH_M, REACH_M, (NUM_POINTS, 2), np.float32)
            if templates is None
            else spaces.Discrete(len(templates))
        )
        self.observation_space = spaces.Dict({
            "images": spaces.Box(0, 255, (num, *image_hw, 3), np.uint8),
            "pixel_from_camera": spaces.Box(-_MAX_PIXELS, _MAX_PIXELS, (num, 3, 3), np.float32),
            "ego_from_camera": spaces.Box(-_MAX_MOUNT_M, _MAX_MOUNT_M, (num, 4, 4), np.float32),
            "speed_mps": spaces.Box(0.0, _MAX_SPEED_MPS, (1,), np.float32),
        })  # fmt: skip

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Seen, dict[str, Any]]:
        """Begin another route.

        Args:
            seed: Of this route and those after it.
            options: None are known.
        """
        super().reset(seed=seed)
        drawn, scene_seed = (int(number) for number in self.np_random.integers(_SEEDS, size=2))
        town_seed = drawn if self._town_seed is None else self._town_seed
        if self._town is None or self._town.seed != town_seed:
            self._town = make_town(town_seed)
        self._simulator = Simulator(self._town, scene_seed, self._mode, self._car, self._duration_s)
        observation = self._simulator.reset()
        self._place_m = observation.world.route_at_m
        return _seen(observation), {"town_seed": town_seed, "scene_seed": scene_seed}

    def step(self, action: Action) -> tuple[Seen, float, bool, bool, dict[str, Any]]:
        """Follow a plan for 0.5 s.

        Raises:
            RuntimeError: If no route has begun, or it is over.
        """
        if self._simulator is None:
            raise RuntimeError("No route has begun; call reset first.")
        if self._templates is None:
            plan = Plan(np.asarray(action, np.float64), DT_S)
        else:
            idx = int(action)
            plan = Plan(np.asarray(self._templates[idx], np.float64), DT_S, idx)
        observation = self._simulator.step(plan)
        place_m = observation.world.route_at_m
        progress_m, self._place_m = place_m - self._place_m, place_m
        touches = _touches(self._simulator.log())
        return _seen(observation), progress_m, touches, self._simulator.is_over, {}

    def log(self) -> RouteLog:
        """Everything that has happened on this route, for scores.

        Raises:
            RuntimeError: If no route has begun.
        """
        if self._simulator is None:
            raise RuntimeError("No route has begun; call reset first.")
        return self._simulator.log()


def _seen(observation: Observation) -> Seen:
    views = observation.sights.views
    return {
        "images": np.stack([view.pixels() for view in views]),
        "pixel_from_camera": np.stack([v.rawpixel_from_camera for v in views]).astype(np.float32),
        "ego_from_camera": np.stack([view.ego_from_camera for view in views]).astype(np.float32),
        "speed_mps": np.array([observation.state.speed_mps], np.float32),
    }


def _touches(log: RouteLog) -> bool:
    """Whether the ego now shares ground with somebody."""
    yaw_rad = log.ego.yaw_rad[-1:]
    overlap = rectangles_overlap(
        footprint_centres(log.ego.xy_m[-1:], yaw_rad),
        yaw_rad,
        np.array([[EGO_LENGTH_M, EGO_WIDTH_M]]),
        log.agents.xy_m[:, -1],
        log.agents.yaw_rad[:, -1],
        log.cast.sizes_m[:, :2],
    )
    return bool(overlap.any())


gymnasium.register(ENV_ID, entry_point="shoot.simulation.environment:CityEnv")
