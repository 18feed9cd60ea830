"""Render a multi-weather data set of a vehicle.

Run inside Blender, ``blender -b -P pipelines/make_dataset.py -- ARGS``, or with the bpy wheel,
``python pipelines/make_dataset.py ARGS``; ``--help`` lists the arguments.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from blender_addon.headless import blender_arguments, run
from pipelines.dataset_options import dataset_job, dataset_parser

if __name__ == "__main__":
    options = dataset_parser().parse_args(blender_arguments())
    sys.exit(run(lambda: dataset_job(options), options.json_progress))
