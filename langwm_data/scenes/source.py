"""What offers scenes: their names, their splits, and how one is made. One class for each kind of source."""

from collections.abc import Mapping
from typing import Protocol

from langwm_data.scenes.assets import Assets
from langwm_data.scenes.spec import SceneSpec, Split


class SceneSource(Protocol):
    """Floors of buildings, each for one split."""

    assets: Assets
    """Holds what the scenes made so far need."""
    identity: Mapping[str, str]
    """SHA-256 of the files of others that scenes are made from, by the field of ``ScenesConfig`` that names
    them: equal configs and identities, equal scenes. Empty where everything is procedural."""
    is_at_rest: bool
    """Whether everything stays where its maker put it: not settled, and not checked for contacts either."""

    def names(self, split: Split | None = None) -> tuple[str, ...]:
        """Names of all floors, or of those of one split."""
        ...

    def make(self, name: str) -> SceneSpec:
        """One floor; loose objects hang a few millimetres above what they will rest on, unless at rest.

        Raises:
            ValueError: If there is no such floor, or what it is made from is damaged.
        """
        ...
