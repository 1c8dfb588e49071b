"""A synthetic city, written to disk as a nuScenes data set.

Data flows `roads -> town -> traffic -> recording -> sensors -> writer`. The rest of `shoot` meets
it only through the files it writes.
"""
