"""Five things to feel, after the publication: materials, a collision, recoil, a weight, a bow.

The publication says of the layouts only that the materials' is grounded and the others mix modules on the body
and in the room: where they stand here, and all numbers, are proposals of this project.

script, person: who is simulated. hold: what brakes are for. scenario, files: what is played. demand: what is asked
for.
"""

from tensionlab.scenarios.brake_target import Hold
from tensionlab.scenarios.demand_source import ScenarioDemand
from tensionlab.scenarios.person import Felt, Person, PersonPlan
from tensionlab.scenarios.scenario import Phase, Scenario
from tensionlab.scenarios.scenario_file import SCENARIOS, load_scenario
from tensionlab.scenarios.script import Script, Sway, Waypoint

__all__ = [
    "SCENARIOS",
    "Felt",
    "Hold",
    "Person",
    "PersonPlan",
    "Phase",
    "Scenario",
    "ScenarioDemand",
    "Script",
    "Sway",
    "Waypoint",
    "load_scenario",
]
