"""Sensors: what they send into a scene, what comes back, and how it is written.

A sensor's figures (`figures`, as makers state them) and settings (`config`) say which rays it sends
(`tripod`, `spinning` along a `route`, `aerial`: batches of `rays`). Each ray is a beam of some
width (`beam`); what comes back of it is grouped into returns, weakened, blurred and lost
(`scanner`), given colors (`daylight`) and written (`output`). A drone's pictures become points
another way (`photogrammetry`, on `depth_maps`). `recording` does all of it for one site; `variety`
says how much sensors of one kind differ.
"""

from bushseg.simulation.sensors.config import SensorConfig

__all__ = ["SensorConfig"]
