"""Whether a labelled scan still is the scan it was made from.

    bushseg.verify("site.las", "labeled.laz").equal

Both files are read again by means that share nothing with how bushseg reads and writes: LAS
containers are taken apart by `struct`, their points decompressed by lazrs, all else is read by
NumPy, laspy, plyfile, Open3D and pye57. An import-linter contract keeps `bushseg.io` out.
"""

from bushseg.verification.pair import verify
from bushseg.verification.result import Check, VerifyResult

__all__ = ["Check", "VerifyResult", "verify"]
