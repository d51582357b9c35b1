"""What may be asked of a rig?"""

from __future__ import annotations

import numpy as np

from tensionlab.demand import Demand
from tensionlab.errors import HardwareError
from tensionlab.files.reading import brief
from tensionlab.model.rig import Rig


def require_demand(demand: object, rig: Rig, here: str) -> Demand:
    """Refuse what no rig, or not this one, can be asked for.

    Parameters
    ----------
    demand : object
        What a demand source returned.
    rig : Rig
    here : str
        What to call it in a message.

    Raises
    ------
    HardwareError
        Saying what is wrong with it.
    """
    if not isinstance(demand, Demand):
        raise HardwareError(f"{here} is {demand!r}; return a Demand")
    if demand.wrench is not None:
        wrench = np.asarray(demand.wrench)
        if wrench.shape != (rig.n,):
            raise HardwareError(f"{here}: wrench is {brief(wrench.tolist())}; this rig takes {rig.n} components")
        if not np.isfinite(wrench).all():
            raise HardwareError(f"{here}: wrench is {brief(wrench.tolist())}; all of it must be finite")
    if demand.impedances or demand.brakes:
        modules = {module.name: module for module in rig.modules}
        for name in (*demand.impedances, *demand.brakes):
            if name not in modules:
                raise HardwareError(f'{here}: no module "{name}"; there are {", ".join(modules)}')
        for name, spring in demand.impedances.items():
            if not np.isfinite(list(vars(spring).values())).all():
                raise HardwareError(f'{here}: module "{name}": {spring}; all of it must be finite')
        for name in demand.brakes:
            if modules[name].brake is None:
                raise HardwareError(f'{here}: module "{name}" has no brake')
    return demand
