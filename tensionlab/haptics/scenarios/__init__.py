"""Five things to feel, after the publication: materials, a collision, recoil, a weight, a bow.

The publication says of the layouts only that the materials' is grounded and the others mix modules on the body
and in the room: where they stand here, and all numbers, are proposals of this project.

script, person: who is simulated. hold: what brakes are for. scenario, files: what is played. demand: what is asked
for.
"""

from tensionlab.haptics.scenarios.demand import ScenarioDemand
from tensionlab.haptics.scenarios.files import SCENARIOS, load_scenario
from tensionlab.haptics.scenarios.hold import Hold
from tensionlab.haptics.scenarios.person import Felt, Person, PersonPlan
from tensionlab.haptics.scenarios.scenario import Phase, Scenario
from tensionlab.haptics.scenarios.script import Script, Sway, Waypoint

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
