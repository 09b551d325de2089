"""`verify`: two files in, what differs out."""

from pathlib import Path

from bushseg.errors import ReadError
from bushseg.progress import SILENT, Progress
from bushseg.scheme import ClassScheme
from bushseg.verification.label_values import LabelValues
from bushseg.verification.las_container import read_container
from bushseg.verification.las_converted import compare_converted
from bushseg.verification.las_copy import check_ends, compare_headers, compare_records
from bushseg.verification.las_extras import label_columns, read_extras
from bushseg.verification.las_records import compare_points
from bushseg.verification.result import Findings, VerifyResult
from bushseg.verification.table_copy import compare_codes, compare_table

LAS_SUFFIXES = (".las", ".laz")
CODE_SUFFIXES = (".label", ".labels")


def verify(
    input: str | Path,  # noqa: A002 - as the command has it
    output: str | Path,
    scheme: ClassScheme | None = None,
    *,
    progress: Progress = SILENT,
) -> VerifyResult:
    """Compare a scan with its labelled copy, in bounded memory.

    LAS to LAS, every byte counts: all fields of all points in order, VLRs, EVLRs, the CRS, the
    header, waveforms. What may differ is what labelling declares: classification, the dimensions
    class_index, confidence and bush_probability with their descriptors, the compression and its
    records, a COPC index, where things stand in the file, and counts and bounds, which are held
    against the points instead.

    To LAS from another format, coordinates must agree to half a step and every attribute be there;
    to a table, every column; to a file of labels, their number and codes.

    Args:
        input: The scan.
        output: What was made of it.
        scheme: The model's classes, which `class_index` must be of; None where they aren't known.
        progress: Told of points compared.

    Returns:
        What was compared and what differs.

    Raises:
        ReadError: A file is missing, or the input can't be read.
    """
    source, copy = Path(input), Path(output)
    for path in (source, copy):
        if not path.is_file():
            raise ReadError(path, "no such file", "an existing one; check the spelling")
    findings = Findings()
    values = LabelValues(None if scheme is None else scheme.num_classes)
    try:
        if copy.suffix.lower() in CODE_SUFFIXES:
            compare_codes(source, copy, scheme, findings, progress)
        elif copy.suffix.lower() not in LAS_SUFFIXES:
            compare_table(source, copy, values, findings, progress)
        elif source.suffix.lower() in LAS_SUFFIXES:
            _compare_las(source, copy, values, findings, progress)
        else:
            compare_converted(source, copy, values, findings, progress)
    except ReadError as error:
        if error.path != copy:
            raise
        findings.differs("file", f"{error.found}; expected {error.expected}")
    except (ValueError, KeyError, TypeError) as error:  # what NumPy and laspy say of damage
        findings.differs("file", f"can't be compared: {error}")
    return findings.result(source, copy)


def _compare_las(
    source: Path, copy: Path, values: LabelValues, findings: Findings, progress: Progress
) -> None:
    before = read_container(source)
    findings.num_points = before.num_points
    after = read_container(copy)
    compare_headers(before, after, findings)
    extras = read_extras(before), read_extras(after)
    compare_records(before, after, extras, findings)
    check_ends(after, findings)
    if before.num_points != after.num_points:
        line = f"{after.num_points:,} points, were {before.num_points:,}"
        findings.differs("counts and bounds", line)
        return
    if before.point_format != after.point_format or after.record_bytes < before.record_bytes:
        line = f"records of {after.record_bytes} bytes, were {before.record_bytes}"
        findings.differs("point records", line)
        return
    labels, wrong = label_columns(*extras)
    for line in wrong:
        findings.differs("VLRs", line)
    compare_points(before, after, extras[0], labels, values, findings, progress)
    values.report(findings, has_codes=True)
    for name, extra in labels.items():
        is_new = extra.start >= before.record_bytes
        findings.declared.append(f"{name} {'added' if is_new else 'written over'}")
    if any(record.user_id == b"copc" for record in before.vlrs) and not any(
        record.user_id == b"copc" for record in after.vlrs
    ):
        findings.declared.append("COPC index left out")
