"""Python interface of phantom-dyn: finds from recordings where, why and how far a robot differs from its model.

For example::

    import phantom_dyn as dyn

    diagnosis = dyn.diagnose("arm.urdf", "log.csv")
    print(diagnosis)

`load_robot`, `read_recording`: read a robot and a recording of it.
`check`: find errors in a recording.
`diagnose`: find the effects that explain the gap between model and recording; returns a `Diagnosis`.
`identify`: estimate inertias, friction and drives of the robot.
`excite`: compute a motion from which the parameters can be identified.
`compare`: list the changes between diagnoses.
`simulate`: simulate the robot with effects that its model lacks.
`map_workspace`: compute mass, friction and stiffness that a hand feels at the tip.

Each function takes paths or objects, one or several. It raises a `PhantomDynError` with one sentence for an input that
it cannot use. Modules other than this one may change from one version to the next. A function is imported when it is
first used.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from identification.api.diagnosis import Diagnosis as Diagnosis
    from identification.api.functions import check as check
    from identification.api.functions import compare as compare
    from identification.api.functions import diagnose as diagnose
    from identification.api.functions import excite as excite
    from identification.api.functions import identify as identify
    from identification.api.functions import map_workspace as map_workspace
    from identification.api.functions import read_recording as read_recording
    from identification.api.functions import simulate as simulate
    from phantom_dyn.errors import PhantomDynError as PhantomDynError
    from phantom_dyn.model.loading import load_robot as load_robot

__version__ = "0.2.0"

_FUNCTIONS = "identification.api.functions"
# Module of each name. Only this module imports both packages; the rest of phantom_dyn does not import identification.
_PLACES = {
    "Diagnosis": "identification.api.diagnosis",
    "PhantomDynError": "phantom_dyn.errors",
    "check": _FUNCTIONS,
    "compare": _FUNCTIONS,
    "diagnose": _FUNCTIONS,
    "excite": _FUNCTIONS,
    "identify": _FUNCTIONS,
    "load_robot": "phantom_dyn.model.loading",
    "map_workspace": _FUNCTIONS,
    "read_recording": _FUNCTIONS,
    "simulate": _FUNCTIONS,
}
__all__ = [
    "Diagnosis",
    "PhantomDynError",
    "__version__",
    "check",
    "compare",
    "diagnose",
    "excite",
    "identify",
    "load_robot",
    "map_workspace",
    "read_recording",
    "simulate",
]


def __getattr__(name: str) -> Any:
    """Load a public name when it is first used, so that the import and the command line start at once."""
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}, it offers {', '.join(__all__)}")
    found = getattr(importlib.import_module(_PLACES[name]), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    """Public names, for tab completion."""
    return sorted(__all__)
