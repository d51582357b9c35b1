"""Five haptic scenarios, after the publication: materials, a collision, recoil, a weight, a bow.

The publication says of the layouts only that the materials' is grounded and the others mix modules on the body
and in the room: where they stand here, and all numbers, are proposals of this project.
"""

from tensionlab.scenarios.demand_source import ScenarioDemand
from tensionlab.scenarios.person import Person, PersonPlan, PersonRecord, Script, Sway, Waypoint
from tensionlab.scenarios.rehearsal import check_needs
from tensionlab.scenarios.scenario import SCENARIOS, BrakeTarget, Phase, Scenario, load_scenario

__all__ = [
    "SCENARIOS",
    "BrakeTarget",
    "Person",
    "PersonPlan",
    "PersonRecord",
    "Phase",
    "Scenario",
    "ScenarioDemand",
    "Script",
    "Sway",
    "Waypoint",
    "check_needs",
    "load_scenario",
]
