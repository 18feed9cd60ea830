"""Render the views of a data set with the vehicle in camouflage.

Run inside Blender, ``blender -b -P pipelines/render_camouflage.py -- ARGS``, or with the bpy wheel,
``python pipelines/render_camouflage.py ARGS``; ``--help`` lists the arguments.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from blender_addon.headless import blender_arguments, run
from pipelines.dataset_options import render_job, render_parser

if __name__ == "__main__":
    options = render_parser().parse_args(blender_arguments())
    sys.exit(run(lambda: render_job(options), options.json_progress))
