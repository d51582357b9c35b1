"""Search anchors in a room that render the largest force everywhere in a target."""

import tensionlab as tl

task = tl.datasets.load("spaces/four-in-a-room")._replace(generations=6, starts=3)
found = task.run()
print(found.best)
for module in found.best.rig.modules:
    print(f"{module.name:12} {module.anchor.round(2)}")
