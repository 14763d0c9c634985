"""Everything that needs no Blender: the native library, the job, the basis, the emotions.

Nothing here imports `bpy`, so it runs in worker threads and in plain Python tests.
"""
