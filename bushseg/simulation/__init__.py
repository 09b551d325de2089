"""Sites made up, with exact labels.

The flow is a straight line: a scene of triangle meshes (`site`, from `terrain`, `plants` and
`structures`) is struck by a sensor's rays (`sensors`), which gives returns (`scanner`), which are
written as a scan (`output`).
"""

from bushseg.simulation.config import SimulateConfig
from bushseg.simulation.simulator import simulate

__all__ = ["SimulateConfig", "simulate"]
