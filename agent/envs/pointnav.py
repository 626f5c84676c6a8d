"""``LangWM/PointNav-v0``: drive to a point in a home, seeing what a camera on the robot sees.

Semantics follow iGibson 1.0's point_nav_random unless ``config.protocol`` asks for Habitat's; what differs
between the two stands in ``protocols``. Running out of time truncates. Reverse driving is allowed.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any, cast

import gymnasium
import numpy as np

from agent.config import EnvConfig
from agent.envs.actions import action_space, read_action
from agent.envs.episodes import Episode, sample_episode
from agent.envs.measures import EpisodeMeasures
from agent.envs.observations import observation_space, observe_task
from agent.envs.protocols import judge, success_radius
from agent.envs.rewards import navigation_reward
from agent.envs.sites import Site, load_scene
from langwm_data.baking import open_scenes
from langwm_data.labels.instances import is_eligible, label_frame
from langwm_data.scenes.navigation import DistanceField
from langwm_data.scenes.spec import MaterialRef, SceneSpec, Split
from langwm_data.scenes.splits import sample_palette
from langwm_data.seeding import make_rng
from langwm_data.sim.camera import Camera
from langwm_data.sim.frame import Frame, Renderer
from langwm_data.sim.lights import Lights, sample_lights
from langwm_data.sim.render import BlindRenderer, make_renderer
from langwm_data.sim.world import RobotState
from pretrain.frames import FrameObject

Observation = dict[str, np.ndarray]


class PointNavEnv(gymnasium.Env[Observation, np.ndarray]):
    """PointGoal navigation in the homes of one split.

    Observation: ``rgb`` uint8 (H, W, 3); ``depth`` float32 (H, W), z-depth in metres, 0 = nothing hit;
    ``task`` float32: straight distance to the goal in metres, its bearing in radians (left positive),
    forward speed in m/s and turning speed in rad/s; with ``config.with_start_pose`` also x and y in metres
    and yaw in radians in the frame of the start.

    Action: as ``config.action`` says, each entry in [-1, 1] and clipped to it. By default (v, omega) in
    units of the config's greatest speeds; v < 0 drives backwards, omega > 0 turns left. With protocol
    ``habitat`` there is one more entry: above ``config.stop_above`` the robot stays and the episode is over.

    ``info`` has the same keys after reset and after every step: the measures so far (``success``,
    ``spl``, ``soft_spl``, ``distance_to_goal``, ``path_length``, ``geodesic_distance``, ``collisions``),
    ``scene``, ``tier``, ``pose`` (x, y, yaw), ``goal`` (x, y) and ``lights`` (4, 3: red, green and blue of
    the ambient light, the sun and the lamps; the direction towards the sun); with ``config.with_labels`` also
    ``instance`` (the mask) and ``objects`` (a ``FrameObject`` for each eligible object).

    ``reset(seed=s)`` plays floor number s modulo the number of floors and every reset without a seed the
    next one, so consecutive seeds visit all floors. ``reset(options={"episode": e})`` plays the given
    ``Episode``. The same seed or episode and the same actions give bit-equal observations.

    Every floor that was visited stays loaded, 100 to 200 MiB each.

    Args:
        config: Sizes, speeds, rewards, protocol, scenes.
        split: ``"train"`` or ``"test"``: whose homes and whose textures.
        scenes: Play in these scenes instead of the homes of the split.
        render_mode: ``"rgb_array"`` lets ``render`` return the current view.

    Raises:
        ValueError: If the config asks for goals nearer than the success radius, or ``split``,
            ``scenes`` or ``render_mode`` is not allowed.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012

    def __init__(
        self,
        config: EnvConfig | None = None,
        split: str = "train",
        scenes: Sequence[SceneSpec] | None = None,
        render_mode: str | None = None,
    ) -> None:
        self.config = config or EnvConfig()
        _check_arguments(self.config, split, scenes, render_mode)
        self.split: Split = cast("Split", split)
        self.render_mode = render_mode
        self._scenes = None if scenes is None else {s.name: s for s in scenes}
        self.scene_names: tuple[str, ...] = (
            open_scenes(self.config.scenes).names(self.split) if scenes is None else tuple(self._scenes or ())
        )
        self._sites: dict[str, Site] = {}
        self._renderers: dict[str, Renderer] = {}
        self._next_floor = 0
        self._is_running = False
        self.observation_space = observation_space(self.config)
        self.action_space = action_space(self.config)
        self.episode: Episode
        self.palette: tuple[MaterialRef, ...]
        self.lights: Lights
        self._lights_info: np.ndarray
        self._site: Site
        self._renderer: Renderer
        self._field: DistanceField
        self._measures: EpisodeMeasures
        self._state: RobotState
        self._frame: Frame
        self._num_steps: int

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode: a drawn one, or ``options["episode"]`` (an ``Episode`` or its dict).

        Raises:
            ValueError: If an option is unknown, or the given episode cannot be played here. The episode
                before goes on then, or, where only the robot found no place, has ended.
        """
        if unknown := set(options or {}) - {"episode"}:
            raise ValueError(f"reset option {sorted(unknown)[0]!r} is unknown; allowed: 'episode'")
        given = (options or {}).get("episode")
        if given is not None:
            given = given if isinstance(given, Episode) else Episode.from_dict(given)
            self._way_of(given)
        super().reset(seed=seed)
        if seed is not None:
            self._next_floor = seed % len(self.scene_names)
        self._begin(self._draw_episode() if given is None else given)
        return self._observe(), self._info()

    def step(self, action: np.ndarray) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Drive for ``config.step_s`` seconds.

        Raises:
            ResetNeeded: If no episode is running.
            ValueError: If the action is not as many finite numbers as it has entries.
        """
        if not self._is_running:
            raise gymnasium.error.ResetNeeded("the episode is over or was never begun; call reset() first")
        config, motion = self.config, read_action(self.config, action)
        before = self._measures.distance_to_goal
        self._state = self._site.world.step(
            motion.linear_m_s, motion.angular_rad_s, config.step_s, turns_first=motion.turns_first
        )
        geodesic = self._geodesic()
        verdict = judge(config, straight_m=self._distance(), geodesic_m=geodesic, is_stop=motion.is_stop)
        self._num_steps += 1
        truncated = not verdict.is_over and self._num_steps >= config.max_steps
        self._is_running = not (verdict.is_over or truncated)
        self._measures.update(
            self._state.xy,
            geodesic,
            is_collision=self._state.is_collision,
            is_success=verdict.is_success,
        )
        reward = navigation_reward(
            config.reward,
            progress_m=before - geodesic,
            is_collision=self._state.is_collision,
            is_success=verdict.is_success,
        )
        return self._observe(), reward, verdict.is_over, truncated, self._info()

    @property
    def field(self) -> DistanceField:
        """Ways to the goal of the running episode: what no policy sees but one that is told."""
        return self._field

    @property
    def robot(self) -> RobotState:
        """Where the robot is, and how it moved last."""
        return self._state

    def render(self) -> np.ndarray | None:
        """The current view, (H, W, 3) uint8; None without a render mode."""
        return self._frame.rgb if self.render_mode == "rgb_array" else None

    def close(self) -> None:
        """Free the renderer and every physics client. The environment cannot be used afterwards."""
        self._is_running = False
        for held in (*self._renderers.values(), *self._sites.values()):
            held.close()
        self._renderers.clear()
        self._sites.clear()

    def _draw_episode(self) -> Episode:
        name = self.scene_names[self._next_floor]
        self._next_floor = (self._next_floor + 1) % len(self.scene_names)
        return sample_episode(self.np_random, self._get_site(name), self.config)

    def _get_site(self, name: str) -> Site:
        if name not in self._sites:
            scene = load_scene(name, self.config) if self._scenes is None else self._scenes[name]
            self._sites[name] = Site(scene, self.config)
        return self._sites[name]

    def _way_of(self, episode: Episode) -> tuple[DistanceField, float]:
        """Ways to an episode's goal, and how long the one from its start is.

        Raises:
            ValueError: If its scene is none of this environment's, or there is no way.
        """
        if episode.scene not in self.scene_names:
            known = ", ".join(self.scene_names)
            raise ValueError(f"episode plays in scene {episode.scene!r}; this environment has {known}")
        field = self._get_site(episode.scene).distance_field(episode.goal_xy)
        distance = float(field.distance(episode.start_xy))
        if not math.isfinite(distance):
            raise ValueError(f"episode in scene {episode.scene!r}: no way leads from its start to its goal")
        return field, distance

    def _begin(self, episode: Episode) -> None:
        field, distance = self._way_of(episode)
        site = self._get_site(episode.scene)
        self._is_running = False  # the world is no longer that of the episode before
        self._state = site.world.reset(episode.start_xy, episode.start_yaw)
        self._field, self._site, self.episode = field, site, episode
        self._show_scene(episode)
        self._measures = EpisodeMeasures(
            geodesic_distance=distance, position=episode.start_xy, distance_to_goal=distance
        )
        self._num_steps = 0
        self._is_running = True

    def _show_scene(self, episode: Episode) -> None:
        scene = self._site.scene
        # Loading takes longer than a short episode, so every floor keeps a renderer.
        if scene.name not in self._renderers:
            config = self.config
            self._renderers[scene.name] = (
                BlindRenderer()
                if config.is_blind
                else make_renderer(config.render, open_scenes(config.scenes).assets)
            )
            self._renderers[scene.name].load(scene)
        self._renderer = self._renderers[scene.name]
        rng = make_rng(episode.palette_seed, "palette")
        self.palette = sample_palette(rng, scene.slots, self.split, scene.pictures)
        self._renderer.set_palette(self.palette)
        self.lights = self._draw_lights(episode)
        self._lights_info = np.array(list(self.lights.describe().values()))
        if self.config.randomize.lights != "fixed":
            self._renderer.set_lights(self.lights)

    def _draw_lights(self, episode: Episode) -> Lights:
        """Those of an episode, the same whenever it is played."""
        config = self.config
        if config.randomize.lights == "fixed":
            return Lights.of(config.render.lights)
        rng = make_rng(episode.palette_seed, "lights")
        return sample_lights(rng, config.render.lights, config.randomize)

    def _geodesic(self) -> float:
        """Length of the shortest way to the goal, metres."""
        distance = float(self._field.distance(self._state.xy))
        # The robot may squeeze through a gap finer than the grid, to where no way is known.
        return distance if math.isfinite(distance) else self._measures.distance_to_goal

    def _distance(self) -> float:
        """Straight distance to the goal, metres."""
        return math.dist(self._state.xy, self.episode.goal_xy)

    def _observe(self) -> Observation:
        state, episode = self._state, self.episode
        self._frame = self._renderer.render(Camera.on_robot(self.config.camera, state.xy, state.yaw))
        start = (episode.start_xy, episode.start_yaw) if self.config.with_start_pose else None
        return {
            "rgb": self._frame.rgb,
            "depth": self._frame.depth,
            "task": observe_task(state, episode.goal_xy, start),
        }

    def _info(self) -> dict[str, Any]:
        info = self._measures.as_info() | {
            "scene": self.episode.scene,
            "tier": self.episode.tier,
            "pose": np.array([*self._state.xy, self._state.yaw], dtype=np.float64),
            "goal": np.array(self.episode.goal_xy, dtype=np.float64),
            "lights": self._lights_info.copy(),
        }
        if self.config.with_labels:
            info |= {"instance": self._frame.instance, "objects": self._seen_objects()}
        return info

    def _seen_objects(self) -> list[FrameObject]:
        frame, config = self._frame, self.config.labels
        # Captions are drawn anew whenever a frame is learned from; the ones made here are not used.
        rng = np.random.default_rng(0)
        labels = label_frame(frame.instance, frame.depth, self._site.scene.instances(), config, rng)
        return [
            FrameObject(
                category=label.category,
                phrase=label.phrase,
                bbox_xyxy=label.bbox_xyxy,
                center_x=label.center_px[0],
                distance_m=label.distance_m,
            )
            for label in labels
            if is_eligible(label, frame.instance.size, config)
        ]


def _check_arguments(
    config: EnvConfig, split: str, scenes: Sequence[SceneSpec] | None, render_mode: str | None
) -> None:
    field, radius_m = success_radius(config)
    if config.distance_edges_m[0] <= radius_m:
        raise ValueError(
            f"distance_edges_m begins at {config.distance_edges_m[0]:g} m;"
            f" it must lie beyond {field}, {radius_m:g} m"
        )
    if split not in ("train", "test"):
        raise ValueError(f"split {split!r} is unknown; allowed: train, test")
    if scenes is not None and not 0 < len({s.name for s in scenes}) == len(scenes):
        raise ValueError(f"scenes {[s.name for s in scenes]} must be at least one, of different names")
    if render_mode not in (None, "rgb_array"):
        raise ValueError(f"render_mode {render_mode!r} is unknown; allowed: None, 'rgb_array'")
