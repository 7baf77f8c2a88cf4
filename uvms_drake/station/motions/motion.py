"""The interface of a kind of motion, for the station and the rooms above it."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, ClassVar, Generic, TypeVar

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort

from uvms_drake.common.errors import within
from uvms_drake.control.laws.law import AncillaryLaw, RunBound
from uvms_drake.control.ocp.ocp import MpcConfig, Ocp
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.uvms_model import UvmsModel
from uvms_drake.plant.disturbance import Disturbance
from uvms_drake.station.signals import Components
from uvms_drake.tube.constants import Constant
from uvms_drake.tube.estimates import CertificateSettings
from uvms_drake.tube.law_tube import Theories
from uvms_drake.tube.search.constraint_set import ConstraintSet

if TYPE_CHECKING:
    from uvms_drake.station.scenario.scenario import Scenario

AnyOcp = TypeVar("AnyOcp", bound=Ocp)
"""Problem of a kind of motion."""


class Motion(ABC, Generic[AnyOcp]):
    """Kind of motion, the input of the simulated robot: forces, or its velocity; a dataclass.

    The plant's output port `measured` goes to the controller's input port of the same name. The
    controller's output `command` goes to the plant's input
    `effect`.
    """

    name: ClassVar[str]
    """Name in a scenario's file."""
    has_forces: ClassVar[bool]
    """Whether forces move the robot: then accelerations are commanded, and there is a surface."""
    measured: ClassVar[str]
    """Name of the port of plant and controller that carries the measured motion."""
    command: ClassVar[str]
    """Name of the controller's output port that moves the robot."""
    effect: ClassVar[str]
    """Name of the plant's input port for the command."""
    tubes: ClassVar[Theories]
    """Theories of the laws that have a certificate."""
    disturbance_symbol: ClassVar[str]
    """Letter of the disturbance."""
    disturbance_unit: ClassVar[str]
    """Unit of the disturbance."""
    disturbance_blocks: ClassVar[tuple[str, ...]]
    """Names of the disturbance's components, three at a time; the last block has the joints."""
    stages: ClassVar[tuple[float, float, float]]
    """Elapsed fractions of the time of a certificate at which tube, terminal set and first plan
    begin, about, in the shipped scenarios."""
    components: ClassVar[Mapping[str, Components]] = {}
    """Components of signals in `log.csv` that are others than in `signals.SIGNALS`."""
    adversaries: ClassVar[tuple[str, ...]]
    """Kinds of disturbance that a campaign draws from."""

    @abstractmethod
    def check(self, scenario: "Scenario") -> None:
        """Raises `InvalidParameter` for the first value that has no meaning with this motion."""

    @abstractmethod
    def disturbance_size(self, size: int) -> int:
        """Returns the number of components of the disturbance, `size` = 6 + n."""

    def weights(self, disturbance: Disturbance, size: int) -> np.ndarray:
        """Returns the diagonal of Ŵ, one for each component of the disturbance, the largest 1."""
        with within("disturbance"):
            return disturbance.relative_weights(self.disturbance_size(size))

    @abstractmethod
    def make_ocp(self, scenario: "Scenario", model: ContactModel) -> AnyOcp:
        """Returns the nominal MPC's problem; see `motions.make_ocp`."""

    @abstractmethod
    def make_plant(self, scenario: "Scenario", start: np.ndarray) -> Diagram:
        """Returns the simulated robot, its disturbance an input port, from 𝔮 = `start` (6+n,)."""

    @abstractmethod
    def make_controller(self, scenario: "Scenario", model: ContactModel, ocp: AnyOcp) -> Diagram:
        """Returns the tube-based NMPC that solves a problem of `make_ocp`."""

    @abstractmethod
    def add_disturbance(self, builder: DiagramBuilder, disturbance: Disturbance, model: UvmsModel,
                        seed: int, signals: Mapping[str, OutputPort]) -> OutputPort:
        """Adds the source of d or w and returns its port; see `Disturbance`."""

    def run_bound(self, law: AncillaryLaw, d_bound: float) -> RunBound | None:
        """Returns the bound along a run in place of the law's own, which is for the dynamics."""
        return None

    def figures(self) -> dict[str, Callable[..., Any]]:
        """Returns figures that no other motion has, by file: functions of a `Record`."""
        return {}

    @abstractmethod
    def completed(self, scenario: "Scenario", model: ContactModel, logs: dict[str, np.ndarray]
                  ) -> dict[str, np.ndarray]:
        """Returns the logs with those fields of a `Record` that this motion alone has."""

    @abstractmethod
    def assumed_settings(self, mpc: MpcConfig) -> list[tuple[str, str, float]]:
        """Returns key, reason and size of this motion's assumptions about the MPC; 0 if kept."""

    @abstractmethod
    def constants(self, names: tuple[str, ...], model: ContactModel, declared: ConstraintSet,
                  weights: np.ndarray, settings: CertificateSettings) -> dict[str, Constant]:
        """Returns constants by name.

        Args:
            names: Names of constants of `tubes`.
            model: The prediction model.
            declared: Set of the suprema.
            weights: Diagonal of Ŵ, see `Basis`.
            settings: Effort of the searches.
        """
