"""Sites made up, with exact labels.

The flow is a straight line: a scene of triangle meshes (`site`, from `terrain`, `plants` and
`structures`) is struck by a sensor's rays (`sensors`), which gives returns (`scanner`), which are
written as a scan (`output`).
"""

from bushseg.simulate.config import SimulateConfig
from bushseg.simulate.simulator import simulate

__all__ = ["SimulateConfig", "simulate"]
