"""Put a trained model into the package: `bushseg/bundled/`, its file and its entry in the index.

    python tools/bundle_model.py runs/close --name close --purpose "tripod and mobile scans, frames"

Weights of two dimensions are stored in half precision, which halves the file; biases and statistics
stay as they are. A model of the same name is replaced. The model card is written by hand.
"""

import argparse
from pathlib import Path

import tomli_w

from bushseg import bundled
from bushseg.bundled import BundledModel
from bushseg.checkpoint import load_model, save_model
from bushseg.runs import find_model


def bundle(run: Path, name: str, purpose: str, spdx: str) -> BundledModel:
    """Store a model and list it.

    Args:
        run: A run's folder or a model file.
        name: What it is to be called.
        purpose: Which scans it is for.
        spdx: Licence of its weights.
    """
    model = load_model(find_model(run))
    for parameter in model.network.parameters():
        if parameter.ndim >= 2:
            parameter.data = parameter.data.half()
    path = bundled.FOLDER / f"{name}.safetensors"
    save_model(path, model.card, model.network)
    entry = BundledModel(
        name=name,
        file=path.name,
        sha256=bundled.file_hash(path),
        license=spdx,
        voxel_size=model.card.prepare.voxel_size,
        purpose=purpose,
    )
    entries = [known for known in bundled.bundled_models() if known.name != name] + [entry]
    size = sum((bundled.FOLDER / known.file).stat().st_size for known in entries)
    if size > bundled.MAX_BYTES:
        raise SystemExit(f"{size:,} bytes in all; at most {bundled.MAX_BYTES:,} may be shipped")
    text = "# Written by tools/bundle_model.py\n"
    text += tomli_w.dumps({"models": [known.model_dump(mode="json") for known in entries]})
    (bundled.FOLDER / bundled.INDEX).write_text(text, encoding="utf-8")
    return entry


def main() -> None:
    """Read the options."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("run", type=Path, help="a run's folder or a model file")
    parser.add_argument("--name", required=True)
    parser.add_argument("--purpose", required=True)
    parser.add_argument("--license", default="MIT", dest="spdx")
    entry = bundle(**vars(parser.parse_args()))
    print(f"{entry.file}: SHA-256 {entry.sha256}")


if __name__ == "__main__":
    main()
