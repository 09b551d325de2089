"""Label points that are in memory, as a robot would: load the model once, then frame after frame.

Run after train_a_model.py, in the same folder: python label_a_frame.py
"""

from pathlib import Path
from time import perf_counter

import bushseg
from bushseg.runs import find_model
from bushseg.simulation import SimulateConfig


def main() -> None:
    model = bushseg.load_model(find_model())
    names = model.card.scheme.names

    (path,) = bushseg.simulate(
        Path("frames"), SimulateConfig(sensor={"kind": "spinning"}, size=20, seed=7)
    )
    frame = bushseg.read(path)
    begun = perf_counter()
    labels, probabilities = bushseg.predict(
        frame.xyz,
        model,
        attributes={"intensity": frame.attributes["intensity"]},
        sensor=(0, 0, 0),
    )
    print(f"{len(labels)} points in {perf_counter() - begun:.2f} s")
    for index, name in enumerate(names):
        print(f"{name:16} {(labels == index).sum():7} points")
    bush = probabilities[:, names.index("bush")]
    print(f"bush within 5 m: {((bush > 0.5) & ((frame.xyz**2).sum(axis=1) < 25)).sum()} points")


if __name__ == "__main__":
    main()
