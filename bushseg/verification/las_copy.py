"""LAS to LAS: everything in the file but for the points."""

import struct
from collections.abc import Sequence
from pathlib import Path

from bushseg.verification.las_container import (
    EXTERNAL_WAVEFORMS,
    EXTRA_BYTES,
    INTERNAL_WAVEFORMS,
    LASZIP,
    STANDARD_HEADER,
    Container,
    Record,
    first_difference,
)
from bushseg.verification.las_extras import DESCRIPTION, Extras
from bushseg.verification.result import Findings

_KEPT = (  # name, layout and place of what labelling leaves alone
    ("file source id", "H", 4),
    ("global encoding", "H", 6),
    ("GUID", "16s", 8),
    ("version", "2B", 24),
    ("system identifier", "32s", 26),
    ("generating software", "32s", 58),
    ("creation day and year", "2H", 90),
    ("header size", "H", 94),
    ("scales", "3d", 131),
    ("offsets", "3d", 155),
)
_CRS = b"LASF_Projection"
_INDEX = b"copc"


def compare_headers(before: Container, after: Container, findings: Findings) -> None:
    """All fields that don't follow from the points."""
    name = "header"
    findings.checked(name, f"{len(_KEPT) + 1} fields and what stands behind them")
    for field, layout, at in _KEPT:
        end = at + struct.calcsize(f"<{layout}")
        if before.header[at:end] != after.header[at:end]:
            line = f"{field} {_shown(after.get(layout, at))}, was {_shown(before.get(layout, at))}"
            findings.differs(name, line)
    if before.point_format != after.point_format:
        line = f"point format {after.point_format}, was {before.point_format}"
        findings.differs(name, line)
    start = STANDARD_HEADER[before.minor]
    if before.header[start:] != after.header[start:]:
        findings.differs(name, "bytes behind the standard fields aren't what they were")
    gaps = [each.point_offset - each.vlr_end for each in (before, after)]
    where = before.vlr_end, after, after.vlr_end
    if gaps[0] != gaps[1] or first_difference(before, *where, gaps[0]) is not None:
        findings.differs(name, "bytes between the VLRs and the points aren't what they were")


def compare_records(
    before: Container, after: Container, extras: tuple[Extras, Extras], findings: Findings
) -> None:
    """VLRs, EVLRs and with them the CRS, in order; and where the waveforms are."""
    grown = before.record_bytes != after.record_bytes
    vlrs, new_vlrs = _counted(before.vlrs, after), _counted(after.vlrs, after)
    evlrs, new_evlrs = _counted(before.evlrs, after), list(after.evlrs)
    findings.checked("VLRs", f"{len(vlrs)} of them")
    findings.checked("EVLRs", f"{len(evlrs)} of them")
    projections = [r for r in before.vlrs + before.evlrs if r.user_id == _CRS]
    findings.checked("CRS", ", ".join(r.name for r in projections) or "none in the scan")
    if grown:
        _take_descriptors(vlrs, new_vlrs, extras, findings)
        evlrs = [record for record in evlrs if record.key != EXTRA_BYTES]
    if before.waveform is not None:
        # LAS 1.4 may point at a record that it doesn't list; the copy lists it.
        starts = {record.start for record in before.evlrs}
        if before.minor >= 4 and before.waveform.start not in starts:
            evlrs.append(before.waveform)
    for kind, old, new in (("VLRs", vlrs, new_vlrs), ("EVLRs", evlrs, new_evlrs)):
        _compare_lists(kind, (before, old), (after, new), findings)
    _compare_waveforms(before, after, findings)


def check_ends(after: Container, findings: Findings) -> None:
    """Nothing overlaps, and nothing stands where no reader would find it."""
    name = "file"
    findings.checked(name, f"{after.size:,} bytes")
    end = after.point_offset  # of compressed points the end isn't known
    exact = not after.compressed
    if exact:
        end += after.num_points * after.record_bytes
    records = {record.start: record for record in (*after.evlrs, after.waveform) if record}
    for _, record in sorted(records.items()):
        start = record.start - len(record.head)
        if start < end or (exact and start != end):
            findings.differs(name, f"EVLR {record.name} at byte {start:,}, not {end:,}")
        end, exact = record.end, True
    if exact and end != after.size:
        findings.differs(name, f"{after.size - end:,} bytes behind everything")
    if after.minor >= 4 and not after.evlrs and struct.unpack_from("<Q", after.header, 235)[0]:
        findings.differs(name, "a place of EVLRs where there are none")


def _counted(records: Sequence[Record], after: Container) -> list[Record]:
    """Records that have to survive: not those of a file's own compression and index."""
    keeps_index = any(record.user_id == _INDEX for record in after.vlrs)
    return [
        record
        for record in records
        if record.key != LASZIP and (keeps_index or record.user_id != _INDEX)
    ]


def _take_descriptors(
    vlrs: list[Record], new_vlrs: list[Record], extras: tuple[Extras, Extras], findings: Findings
) -> None:
    """Take the extra bytes' VLR, which has grown or is new, out of the lists."""
    old = next((record for record in vlrs if record.key == EXTRA_BYTES), None)
    new = next((record for record in new_vlrs if record.key == EXTRA_BYTES), None)
    if new is None or new is not extras[1].record:
        findings.differs("VLRs", "none describes the added dimensions")
        return
    if old is None:
        where, head = len(new_vlrs) - 1, struct.pack("<H16sHH32s", 0, *EXTRA_BYTES, 0, DESCRIPTION)
    else:
        where, head = vlrs.index(old), old.head
    expected = head[:20] + struct.pack("<H", new.length) + head[22:]
    if new_vlrs.index(new) != where or new.head != expected or new.length % 192:
        findings.differs("VLRs", f"{new.name} isn't headed as it was, or not in its place")
    new_vlrs.remove(new)
    if old is not None:
        vlrs.remove(old)


def _compare_lists(
    kind: str,
    before: tuple[Container, list[Record]],
    after: tuple[Container, list[Record]],
    findings: Findings,
) -> None:
    (source, old), (output, new) = before, after
    if len(old) != len(new):
        findings.differs(kind, f"{len(new)} besides descriptors and compression, were {len(old)}")
    for index, (a, b) in enumerate(zip(old, new, strict=False)):
        check = "CRS" if a.user_id == _CRS else kind
        title = f"{kind[:-1]} {index + 1}"
        if a.key != b.key:
            findings.differs(check, f"{title} is {b.name}, was {a.name}")
        elif a.head != b.head:
            at = next(i for i, (p, q) in enumerate(zip(a.head, b.head, strict=False)) if p != q)
            findings.differs(check, f"{title}, {a.name}: byte {at} of its header differs")
        else:
            place = first_difference(source, a.start, output, b.start, a.length)
            if place is not None:
                findings.differs(check, f"{title}, {a.name}: byte {place:,} of its content differs")


def _compare_waveforms(before: Container, after: Container, findings: Findings) -> None:
    """That the header points at them, and a file beside the scan has a copy beside the output."""
    if before.minor < 3:
        return
    name = "waveforms"
    encoding = before.get("H", 6)[0]
    old, new = before.waveform, after.waveform
    if encoding & INTERNAL_WAVEFORMS and old is not None:
        findings.checked(name, f"{old.length:,} bytes in the file")
        if new is None:
            findings.differs(name, "the header doesn't point at them")
        elif old.head != new.head or (
            first_difference(before, old.start, after, new.start, old.length) is not None
        ):
            findings.differs(name, "aren't what they were")
        return
    if before.header[227:235] != after.header[227:235]:
        findings.differs(
            name, f"at byte {after.get('Q', 227)[0]:,}, was {before.get('Q', 227)[0]:,}"
        )
    beside = before.path.with_suffix(".wdp")
    if encoding & EXTERNAL_WAVEFORMS and beside.exists():
        findings.checked(name, f"{beside.name} beside the scan")
        copy = after.path.with_suffix(".wdp")
        if not copy.exists():
            findings.differs(name, f"{copy.name} is missing; copy {beside.name} to it")
        elif not _same_files(beside, copy):
            findings.differs(name, f"{copy.name} isn't {beside.name}")


def _same_files(left: Path, right: Path) -> bool:
    if left.stat().st_size != right.stat().st_size:
        return False
    with left.open("rb") as a, right.open("rb") as b:
        while block := a.read(1 << 20):
            if block != b.read(1 << 20):
                return False
    return True


def _shown(values: tuple[object, ...]) -> str:
    """Header values for people."""
    texts = [
        repr(value.rstrip(b"\0").decode("latin-1")) if isinstance(value, bytes) else f"{value}"
        for value in values
    ]
    return " ".join(texts)
