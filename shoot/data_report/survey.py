"""Everything a report on a data set says, from its index and a few of its files."""

from pathlib import Path

from lss_core.data.samples import SampleIndex
from shoot.data_report.contents import describe_boxes, describe_locations
from shoot.data_report.drives import describe_drives, describe_futures, describe_motion
from shoot.data_report.facts import DataReport
from shoot.data_report.findings import file_findings, index_findings, use_findings
from shoot.data_report.rig import describe_camera, describe_lidar

_ORDER = ("error", "warning", "note")


def survey(index: SampleIndex, root: Path, version: str) -> DataReport:
    """Look at a data set as a whole.

    Args:
        index: Of the data set.
        root: Its folder.
        version: Name of the tables' folder.

    Raises:
        DataError: If a table or `splits.json` cannot be read.
    """
    folder = root / version
    cameras = tuple(describe_camera(index, root, n) for n in range(len(index.cameras)))
    lidar = describe_lidar(index, root)
    drives, futures = describe_drives(index, folder), describe_futures(index)
    boxes, box_findings = describe_boxes(index, folder)
    locations, map_findings = describe_locations(index, root)
    findings = (
        *index_findings(index),
        *file_findings(cameras, lidar),
        *box_findings,
        *map_findings,
        *use_findings(drives, futures, folder),
    )
    return DataReport(
        name=root.resolve().name,
        version=version,
        drives=drives,
        motion=describe_motion(index),
        futures=futures,
        cameras=cameras,
        lidar=lidar,
        boxes=boxes,
        locations=locations,
        findings=tuple(sorted(findings, key=lambda finding: _ORDER.index(finding.level))),
    )
