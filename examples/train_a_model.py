"""Train on simulated sites; your own labelled scans go the same way.

Run in an empty folder: python train_a_model.py
"""

from pathlib import Path

import bushseg
from bushseg.config import Config, PrepareConfig, TrainConfig
from bushseg.simulation import SimulateConfig

SMALL = {
    "size": 20,
    "sensor": {"stations": 2, "angular_step": 0.7},
}


def main() -> None:
    sites = bushseg.simulate(Path("scans"), SimulateConfig(num_sites=2, seed=1, **SMALL))
    print("simulated", *sites)

    prepared = bushseg.prepare(["scans"], "prepared", PrepareConfig(voxel_size=0.2))
    print("prepared", prepared.num_voxels, "voxels:", prepared.class_counts)

    # Two epochs show how it is done; a useful model takes dozens.
    config = Config(train=TrainConfig(epochs=2))
    result = bushseg.train("prepared", "runs/example", config, overwrite=True)
    print("trained; held-out mIoU by epoch:", [round(row["val_miou"], 3) for row in result.history])


if __name__ == "__main__":
    main()
