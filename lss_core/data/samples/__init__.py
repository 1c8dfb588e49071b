"""An index of samples, cameras, poses and scenes: what training needs of the nuScenes tables."""

from lss_core.data.samples.index import TIME_TOLERANCE_S, SampleIndex
from lss_core.data.samples.loading import load_index
from lss_core.data.samples.split_rows import rows_of_split

__all__ = ["TIME_TOLERANCE_S", "SampleIndex", "load_index", "rows_of_split"]
