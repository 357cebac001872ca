"""The task of a mission, and the swarms that fly it."""

from pydantic import Field

from voxdepth.model import Model

from .controllers import DEFAULT_CONTROLLER
from .formation import FormationConfig
from .link import LinkConfig
from .neighbours import NeighbourConfig
from .pilot import PilotConfig
from .priors import PosePriorConfig
from .rules import RuleWeights
from .team import Route, Team


class MissionConfig(Model):
    """The task, and the swarms that fly it: one for each route."""

    routes: tuple[Route, ...] = Field((Route(),), min_length=1, strict=False)
    drones: int = Field(8, ge=1)
    """Of each swarm. Its first one leads, all others follow."""
    duration_s: float = Field(75.0, gt=0)
    """Simulated time after which the mission counts as timed out."""
    cruise_speed_m_s: float = Field(2.5, gt=0)
    """Speed of a leader."""
    follower_speed_m_s: float = Field(3.2, gt=0)
    """Largest speed of a follower; above the leader's, to catch up."""
    control_hz: int = Field(20, ge=1)
    """Decisions of each drone per second; must divide the rate of the physics."""
    latency_s: float = Field(0.03, ge=0)
    """Simulated time from a capture to the moment its raw depth is there; that of the corrector comes on top."""
    goal_radius_m: float = Field(1.5, gt=0)
    """Distance from its goal within which a leader has arrived."""
    formation_tolerance_m: float = Field(1.5, gt=0)
    """Largest distance of any follower from its slot that counts as being in formation."""
    deadlock_s: float = Field(12.0, gt=0)
    """Time in which neither leaders nor followers get anywhere, after which the mission counts as stuck."""
    lost_m: float = Field(30.0, gt=0)
    """Distance from its leader beyond which a follower counts as lost."""
    aftermath_s: float = Field(1.0, ge=0)
    """How long the world runs on after the first collision."""
    controller: str = DEFAULT_CONTROLLER
    """Who decides for each drone: `module:factory`, where factory(role, config) returns an agent."""
    formation: FormationConfig = FormationConfig()
    rules: RuleWeights = RuleWeights()
    pilot: PilotConfig = PilotConfig()
    neighbours: NeighbourConfig = NeighbourConfig()
    link: LinkConfig = LinkConfig()
    pose_prior: PosePriorConfig = PosePriorConfig()

    def teams(self) -> list[Team]:
        """One per route."""
        n = self.drones
        return [Team.of(route, range(i * n, (i + 1) * n), self.formation) for i, route in enumerate(self.routes)]
