"""The run folder of a planner: templates, and what its baselines are fitted to."""

from pathlib import Path

from shoot.templates import TemplateSet
from shoot.training.planning.config import TrainConfig
from shoot.training.run_folder import RunFolder


class PlanningRun(RunFolder):
    """Where things of a planner's run are."""

    @property
    def templates_file(self) -> Path:
        """The run's own copy of its templates."""
        return self.folder / "templates.npz"

    @property
    def motion_file(self) -> Path:
        """What its baselines are fitted to."""
        return self.folder / "training_motion.npz"

    @property
    def past_motion_file(self) -> Path:
        """Networks of the baseline past motion, kept by the first evaluation."""
        return self.folder / "past_motion.safetensors"

    def config(self) -> TrainConfig:
        """What the run was told; see `read_config`.

        Raises:
            DataError: If this is no run folder.
        """
        return self.read_config(TrainConfig)

    def templates(self) -> TemplateSet:
        """The templates it was trained with.

        Raises:
            DataError: If they are missing.
        """
        return TemplateSet.load(self.templates_file)
