"""What a scan's coordinates are counted in."""

import re

# WKT's name of a unit, or the GeoTIFF codes of the international and the US survey foot.
_FEET = re.compile(r'UNIT\["[^"]*(?:foot|feet|ftUS)|Units=900[23]\b', re.IGNORECASE)


def counts_in_feet(crs: str | None) -> bool:
    """Whether a coordinate reference system, as a file states it, counts in feet."""
    return crs is not None and _FEET.search(crs) is not None
