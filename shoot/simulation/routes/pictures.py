"""A driven route as pictures: what is filmed of it, with what went wrong by the score's rules."""

from pathlib import Path

from lss_core.files import write_atomically
from shoot.simulation.filming.film import Film
from shoot.simulation.filming.frames import draw_frames
from shoot.simulation.filming.mishaps import Mishap, find_mishaps
from shoot.simulation.filming.strip import strip_jpeg
from shoot.simulation.filming.video import write_video
from shoot.simulation.routes.result_files import strip_file, video_file
from shoot.simulation.routes.scene import FIRST_STEP, RouteScene


def write_pictures(film: Film, folder: Path, route: int, with_video: bool) -> None:
    """Write a route's filmstrip, and its video if asked for.

    Args:
        film: The route.
        folder: Of results.
        route: Its number.
        with_video: Whether a video is wanted, too.
    """
    with write_atomically(strip_file(folder, route)) as stream:
        stream.write(strip_jpeg(film))
    if with_video:
        write_video(draw_frames(film), video_file(folder, route))


def mishaps_of(scene: RouteScene) -> tuple[Mishap, ...]:
    """What went wrong from the hand-over on."""
    return find_mishaps(
        scene.ego,
        scene.others,
        scene.names,
        scene.ground.lawful,
        scene.ground.strict,
        start_s=FIRST_STEP * scene.ego.dt_s,
    )
