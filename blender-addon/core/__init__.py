"""Everything that needs no Blender: the native library, the job, the basis, the emotions.

Nothing here imports `bpy`, so it runs in worker threads and in plain Python tests. The Python wheel
holds the same files, which is why this folder, unlike the rest of the extension, is licensed under
MIT OR Apache-2.0.
"""

# SPDX-License-Identifier: MIT OR Apache-2.0
