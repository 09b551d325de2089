"""Label a scan file with the newest model, and judge the result.

Run after train_a_model.py, in the same folder: python label_a_scan.py
"""

from pathlib import Path

import bushseg
from bushseg.simulation import SimulateConfig

SMALL = {
    "size": 20,
    "sensor": {"stations": 2, "angular_step": 0.7},
}


def main() -> None:
    (site,) = bushseg.simulate(Path("unseen"), SimulateConfig(seed=100, **SMALL))

    result = bushseg.predict_file(site, "labeled.laz", overwrite=True)
    print(f"{result.num_points} points at {result.points_per_second:.0f} points/s")
    print(result.class_counts)

    scores = bushseg.evaluate(Path("labeled.laz"), site, bushseg.load_scheme("bush")).confusion
    print(f"mIoU {scores.miou:.3f}, OA {scores.oa:.3f}")

    points = bushseg.read("labeled.laz")
    bush = points.attributes["bush_probability"] > 0.5
    print(f"{bush.sum()} points are probably bush")


if __name__ == "__main__":
    main()
