"""Networks, one a file."""

import os

# Linux hands out memory in pages of 4 KiB, each when it is first touched; where it has larger ones
# for the asking, PyTorch asks for them if this stands when it first allocates. Every layer of a
# large tile writes a new tensor of tens of megabytes.
os.environ.setdefault("THP_MEM_ALLOC_ENABLE", "1")

# For each shape that it multiplies oneDNN compiles a program, and keeps a thousand of them, which
# training's many shapes would fill. Those of `chunks.py` fit in so many.
os.environ.setdefault("ONEDNN_PRIMITIVE_CACHE_CAPACITY", "128")
