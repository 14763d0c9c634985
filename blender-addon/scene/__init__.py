"""Works on Blender's data, without any interface: reads mesh and sound, writes and removes keys."""
