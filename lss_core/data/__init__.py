"""Disk to Batch: nuScenes tables, images and what is cached of them; and recordings to tables."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from lss_core.data.writing.scene_writer import SceneWriter
    from lss_core.data.writing.tables_writer import TablesWriter

__all__ = ["SceneWriter", "TablesWriter"]


def __getattr__(name: str) -> Any:
    """The writers, loaded when asked for: those who only read, or look up a split, never wait."""
    if name == "TablesWriter":
        from lss_core.data.writing.tables_writer import TablesWriter

        return TablesWriter
    if name == "SceneWriter":
        from lss_core.data.writing.scene_writer import SceneWriter

        return SceneWriter
    raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
