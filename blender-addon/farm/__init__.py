"""Batches of shots: jobs file, shot processes, reports, Dask. Runs without Blender's Python."""
