"""A report on a data set as text for a terminal."""

import io
import math
from collections.abc import Iterator

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from lss_core.legible import legible
from shoot.data_report.facts import (
    CameraFacts,
    DataReport,
    DriveFacts,
    Finding,
    FutureFacts,
    LidarFacts,
    LocationFacts,
    MotionFacts,
    SplitFacts,
    Spread,
)
from shoot.trajectories import HORIZON_S

_CAMERA_COLUMNS = (
    "camera",
    "images\nshare",
    "size\npx",
    "height\nm",
    "yaw\ndeg",
    "pitch\ndeg",
    "roll\ndeg",
    "field\ndeg",
    "centre\npx",
)


def format_report(report: DataReport, width: int = 100) -> str:
    """The report as text: what was read, the cameras, the boxes, and last the findings.

    Args:
        report: What to show.
        width: Columns of the terminal, for all but the findings, which are one line each.
    """
    console = Console(file=io.StringIO(), width=width, color_system=None)
    with console.capture() as captured:
        console.print(_overview(report))
        console.print(_camera_table(report.cameras))
        if report.boxes:
            console.print(_box_table(report))
    tables = (line.rstrip() for line in captured.get().splitlines())
    return "\n".join([*tables, *format_findings(report.findings)])


def format_findings(findings: tuple[Finding, ...]) -> list[str]:
    """A line each; the first one says how many there are."""
    if not findings:
        return ["Findings: none."]
    return [f"Findings: {len(findings)}", *map(_finding, findings)]


def _finding(finding: Finding) -> str:
    where = f" ({finding.where})" if finding.where else ""
    more = finding.num_texts - len(finding.texts)
    texts = "; ".join(finding.texts) + (f"; and {more} more" if more else "")
    return " ".join(legible(f"{finding.level}: {finding.reason}{where}: {texts}.").split())


def _overview(report: DataReport) -> Table:
    table = Table(
        title=Text(f"{legible(report.name)}, {legible(report.version)}"),
        box=None,
        show_header=False,
        padding=(0, 2, 0, 0),
    )
    table.add_column(no_wrap=True)
    table.add_column()
    for name, text in _facts(report):
        table.add_row(name, Text(legible(text)))
    return table


def _facts(report: DataReport) -> Iterator[tuple[str, str]]:
    yield from _drive_facts(report.drives)
    yield from _motion_facts(report.motion)
    yield from _future_facts(report.futures, report.drives)
    yield "lidar", _lidar(report.lidar)
    places = (
        f"{place.name} ({_count(place.num_scenes, 'scene')}, {_map(place)})"
        for place in report.locations
    )
    yield "places", ", ".join(places)
    if report.boxes is None:
        yield "boxes", "no usable tables of annotations: no collision rates"
    elif not report.boxes:
        yield "boxes", "none: no collision rates"


def _map(place: LocationFacts) -> str:
    if not place.has_map:
        return "without map"
    return "map" if math.isnan(place.on_road) else f"{place.on_road:.0%} on its map's road"


def _drive_facts(drives: DriveFacts) -> Iterator[tuple[str, str]]:
    dates = drives.first if drives.first == drives.last else f"{drives.first} to {drives.last}"
    scenes, logs = _count(drives.num_scenes, "scene"), _count(drives.num_logs, "log")
    yield "scenes", f"{scenes} of {logs}, {dates or 'without poses'}"
    splits = "; ".join(map(_split, drives.splits)) or "none names a scene that is here"
    rest = drives.num_scenes_in_no_split
    yield "splits", splits + (f"; {_count(rest, 'scene')} in none" if rest else "")
    yield "keyframes", f"{drives.num_samples}{_steps(drives.keyframe_step_s)}"
    gaps = f"; {_count(drives.num_gaps, 'gap')}" if drives.num_gaps else "; no gap"
    yield "poses", f"{drives.num_poses}{_steps(drives.pose_step_s)}{gaps}"


def _split(split: SplitFacts) -> str:
    if split.num_scenes == split.num_listed:
        here = f"all {split.num_listed} scenes"
    else:
        here = f"{split.num_scenes} of {split.num_listed} scenes"
    return f"{split.name}: {here} ({_count(split.num_samples, 'sample')})"


def _steps(step_s: Spread) -> str:
    if math.isnan(step_s.median):
        return ""
    rate = f", {1.0 / step_s.median:.3g} a second" if step_s.median > 0.0 else ""
    return f"{rate} (steps of {step_s.least:.3g} to {step_s.most:.3g} s)"


def _motion_facts(motion: MotionFacts) -> Iterator[tuple[str, str]]:
    speed, angle, tilt = motion.speed_mps, motion.off_axis_deg, motion.tilt_deg
    if not math.isnan(speed.median):
        tail = f"95 % below {speed.high:.1f}, largest {speed.most:.1f}"
        yield "speed", f"median {speed.median:.1f} m/s, {tail}"
        others = f"{motion.turning:.0%} turning, {motion.reversing:.0%} reversing"
        yield "of the time", f"{motion.standing:.0%} standing, {others}"
    if motion.num_off_axis:
        spread = f"90 %: {angle.low:+.1f} to {angle.high:+.1f}"
        text = f"{angle.median:+.1f} deg from the ego's x axis, left positive ({spread})"
        yield "direction", text
    if not math.isnan(tilt.median):
        yield "tilt", f"median {tilt.median:.1f} deg against global z, largest {tilt.most:.1f}"


def _future_facts(futures: FutureFacts, drives: DriveFacts) -> Iterator[tuple[str, str]]:
    manoeuvres = ", ".join(f"{count} {name}" for name, count in futures.manoeuvres.items())
    keyframes = _count(drives.num_samples, "keyframe")
    labels = f"{futures.num_labels} of {keyframes} have {HORIZON_S:g} s of future"
    yield "futures", f"{labels} ({manoeuvres})" if futures.num_labels else labels
    yield "", f"{futures.num_starts} of {_count(drives.num_poses, 'pose')} to fit templates to"


def _lidar(lidar: LidarFacts) -> str:
    if not lidar.num_keyframes:
        return "none"
    return (
        f"{_count(lidar.num_keyframes, 'keyframe')} ({lidar.share:.0%} of samples), "
        f"{_count(lidar.num_sweeps, 'sweep')}, {_value(lidar.height_m, '.2f')} m above the ground"
    )


def _camera_table(cameras: tuple[CameraFacts, ...]) -> Table:
    table = _table("Cameras: above the ground, from the ego's x axis, left and up positive")
    for name in _CAMERA_COLUMNS:
        # Long names may be broken, but numbers never.
        is_first = name == _CAMERA_COLUMNS[0]
        table.add_column(
            name,
            justify="left" if is_first else "right",
            no_wrap=not is_first,
            min_width=15 if is_first else None,
            overflow="fold" if is_first else "ellipsis",
        )
    for camera in cameras:
        table.add_row(*map(Text, _camera_cells(camera)))
    return table


def _camera_cells(camera: CameraFacts) -> list[str]:
    return [
        legible(camera.channel),
        f"{camera.num_images}\n{camera.share:.0%}",
        "\n".join(camera.sizes),
        _cell(camera.height_m, ".2f"),
        _cell(camera.yaw_deg, "+.1f"),
        _cell(camera.pitch_deg, "+.1f"),
        _cell(camera.roll_deg, "+.1f"),
        _cell(camera.field_deg, ".1f"),
        f"{_value(camera.principal_x_px, '.0f')}, {_value(camera.principal_y_px, '.0f')}",
    ]


def _cell(spread: Spread, form: str) -> str:
    """The median; in two lines below it the range, where it is not of one value."""
    text = _value(spread, form)
    least, most = _number(spread.least, form), _number(spread.most, form)
    return text if least == most else f"{text}\n{least} to\n{most}"


def _value(spread: Spread, form: str) -> str:
    return "-" if math.isnan(spread.median) else _number(spread.median, form)


def _number(value: float, form: str) -> str:
    # Adding zero takes the sign of what rounds to it.
    return format(round(value, int(form.strip("+.f"))) + 0.0, form)


def _box_table(report: DataReport) -> Table:
    table = _table("Boxes")
    table.add_column("category")
    table.add_column("boxes", justify="right")
    table.add_column("in collisions")
    for category in report.boxes or ():
        counted = {True: "yes", False: "no", None: "unknown"}[category.is_counted]
        table.add_row(Text(legible(category.name)), str(category.num_boxes), counted)
    return table


def _table(title: str) -> Table:
    return Table(
        title=title, title_justify="left", box=SIMPLE_HEAD, padding=(0, 1, 0, 0), title_style=""
    )


def _count(number: int, name: str) -> str:
    return f"{number} {name}{'' if number == 1 else 's'}"
