"""Five haptic scenarios, after the publication: materials, a collision, recoil, a weight, a bow.

The publication says of the layouts only that the materials' is grounded and the others mix modules on the body
and in the room: where they stand here, and all numbers, are proposals of this project.

Examples
--------
A `Scenario` in Python, on the rig of another one. In simulation its `Person` moves by a `PersonPlan`, and leaves a
`PersonRecord`; a `ScenarioDemand` is the demand source of a runner.

>>> from dataclasses import replace
>>> from tensionlab.haptics.effects import Plane, Wall
>>> from tensionlab.scenarios import *
>>> press = Script((Waypoint(0.0, (0.0, 0.0, 1.05)), Waypoint(0.5, (0.0, 0.0, 0.98))), Sway((0.0, 0.01, 0.0)))
>>> hand = PersonPlan(mass=0.8, stiffness=300.0, damping=25.0, script=press)
>>> stop = BrakeTarget(force=30.0, plane=Plane(point=(0.0, 0.0, 0.97)))
>>> shelf = Phase("shelf", begin=0.0, end=1.0, effects={"shelf": Wall(Plane(point=(0.0, 0.0, 1.0)))}, hold=stop)
>>> scenario = replace(load_scenario("materials"), name="shelf", seconds=1.0, person=hand, phases=(shelf,))
>>> [(finding.name, finding.passed) for finding in check_needs(scenario)]
[('reach', True), ('shelf', True), ('shelf: brakes', True)]
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
