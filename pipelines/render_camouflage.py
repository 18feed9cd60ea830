"""Render the views of a data set with the vehicle in camouflage.

Run inside Blender, ``blender -b -P pipelines/render_camouflage.py -- ARGS``, or with the bpy wheel,
``python pipelines/render_camouflage.py ARGS``; ``--help`` lists the arguments.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from blender_addon.headless import blender_arguments, render_camouflages

if __name__ == "__main__":
    sys.exit(render_camouflages(blender_arguments()))
