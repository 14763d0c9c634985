"""Many shots: the jobs file, one process a shot, reports, Dask. Runs without Blender's Python."""
