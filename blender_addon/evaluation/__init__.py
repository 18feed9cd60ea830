"""What an evaluation found, for showing it in Blender; no bpy in here."""
