"""The one door to Open3D.

Importing Open3D costs about a second and, on a clean Linux machine, fails for want of
`libusb-1.0.so.0`, which it needs for depth cameras only. Everything that uses Open3D calls
:func:`open3d`, which loads the library from the `libusb-package` wheel first where the system has
none. `bushseg --help` never comes here.
"""

import ctypes
import importlib
import sys
from functools import cache
from typing import Any


@cache
def open3d() -> Any:
    """Import Open3D, whatever the system lacks.

    Returns:
        The `open3d` module.
    """
    if sys.platform == "linux":
        try:
            ctypes.CDLL("libusb-1.0.so.0", mode=ctypes.RTLD_GLOBAL)
        except OSError:
            import libusb_package

            ctypes.CDLL(str(libusb_package.get_library_path()), mode=ctypes.RTLD_GLOBAL)
    module = importlib.import_module("open3d")
    module.utility.set_verbosity_level(module.utility.VerbosityLevel.Error)
    return module
