"""A robot as it is loaded from its folder: once, by one reader, for everything that uses it."""

from dataclasses import dataclass
from pathlib import Path

from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.systems.framework import DiagramBuilder

from uvms_drake.common.errors import InvalidFile
from uvms_drake.model.description.robot_files import RobotFiles, model_dir, read_robot_files
from uvms_drake.model.uvms import Uvms, add_uvms


@dataclass(frozen=True)
class Robot:
    """A robot whose files can be used: the input of checks, of a station and of a picture."""

    files: RobotFiles
    """Content of its files."""
    uvms: Uvms
    """The robot alone in a finalized, continuous plant that is registered with a SceneGraph."""

    @staticmethod
    def load(model: str | Path) -> "Robot":
        """Returns a shipped robot by its name, or a robot by its folder.

        Raises:
            InvalidParameter: The robot's files cannot be used; an `InvalidFile` has all that is
                wrong with them.
        """
        files = read_robot_files(model_dir(str(model)))
        plant, _ = AddMultibodyPlantSceneGraph(DiagramBuilder(), time_step=0.0)
        uvms = add_uvms(plant, files)
        try:
            plant.Finalize()
        except RuntimeError as error:  # Of links in a loop.
            raise InvalidFile([f"{files.file}: must be a readable robot: "
                               f"{' '.join(str(error).split())}"]) from None
        return Robot(files, uvms)

    @property
    def name(self) -> str:
        """That of its folder and of its file."""
        return self.folder.name

    @property
    def folder(self) -> Path:
        """Folder of its files."""
        return self.files.folder

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on its files, a line each: no mistakes, but worth knowing."""
        return tuple(self.files.notes)

    def add_to(self, plant: MultibodyPlant) -> Uvms:
        """Adds the robot to another plant, which is not finalized, and returns its handles there.

        Args:
            plant: Registered with a SceneGraph, if the robot is to be drawn.
        """
        return add_uvms(plant, self.files)
