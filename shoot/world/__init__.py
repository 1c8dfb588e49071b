"""A synthetic city, written to disk as a nuScenes data set.

Data flows `town -> traffic -> looks -> sensing -> nuscenes -> writer`. The rest of `shoot` meets
it only through the files it writes.
"""
