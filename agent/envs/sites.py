"""A scene made ready to drive in: its free space and its physics, built once and kept."""

from types import TracebackType

from agent.config import EnvConfig
from langwm_data.baking import open_scenes
from langwm_data.scenes.navigation import DistanceField, FreeSpace
from langwm_data.scenes.spec import SceneSpec
from langwm_data.sim.world import SKIN_M, World


def load_scene(name: str, config: EnvConfig) -> SceneSpec:
    """The floor called ``name``, its loose things at rest.

    Raises:
        ValueError: If there is no such floor, or ``config.scenes.baked`` names no dataset that has it.
    """
    return open_scenes(config.scenes).load(name)


class Site:
    """One scene with what the environment needs of it. Holds a physics client until closed."""

    def __init__(self, scene: SceneSpec, config: EnvConfig) -> None:
        self.scene = scene
        self.free = FreeSpace.from_scene(scene, robot=config.robot)
        self.world = World(scene, config.robot, physics_hz=config.physics_hz, contacts=config.contacts)
        self._last_field: tuple[tuple[float, float], DistanceField] | None = None

    def distance_field(self, goal_xy: tuple[float, float]) -> DistanceField:
        """Distances to a goal; the last one asked for is kept, as it is asked for again when played.

        Raises:
            ValueError: If the robot cannot stand at the goal.
        """
        if self._last_field is None or self._last_field[0] != goal_xy:
            self._last_field = goal_xy, self.free.distance_field(goal_xy)
        return self._last_field[1]

    def can_begin_at(self, xy: tuple[float, float]) -> bool:
        """Whether the robot can be put at a place of the free space without touching anything.

        Asked of the map, whose outlines leave out nothing, so that episodes do not depend on
        ``config.contacts``.
        """
        return self.free.clearance(xy) > self.free.radius_m + SKIN_M

    def close(self) -> None:
        """Free the physics client."""
        self.world.close()

    def __enter__(self) -> "Site":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
