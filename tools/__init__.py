"""Programs that make the checkout's own files and the Blender extension."""
