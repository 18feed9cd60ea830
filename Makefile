# Two commands do everything on a fresh machine: `make demo` and `make test`.
PYTHON ?= $(shell command -v python3.11 || command -v python3)
VENV := .venv
DEMO := $(VENV)/.demo
READY := $(VENV)/.ready
MMDETECTION := $(VENV)/mmdetection/.ready

# Hundreds of processes start in a run of the tests, and some in a demo; each would compile the house again.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: install demo test test-matrix test-gui coverage lint docs pictures extension clean

install: $(READY)

demo: $(DEMO)
	$(VENV)/bin/rauca demo

# A process a core; a file's tests stay together, as they share what they rendered.
PARALLEL := -n auto --dist loadfile --no-loadscope-reorder
PLAINER := $(VENV)/bin/python tests/plainer_processor.py
# What compares with the results of another machine runs again as if on plainer processors (docs/reliability.md).
test: $(READY) $(MMDETECTION)
	$(VENV)/bin/python -m pytest $(PARALLEL)
	$(PLAINER) avx2 $(VENV)/bin/python -m pytest $(PARALLEL) -m stored
	$(PLAINER) sse4 $(VENV)/bin/python -m pytest $(PARALLEL) -m stored

# What runs inside Blender, on the current wheel and on the long-term release.
MATRIX := tests/blender tests/pipelines/test_headless.py tests/pipelines/test_jobs.py
test-matrix: $(READY) $(VENV)-4.5/.ready
	$(VENV)/bin/python -m pytest $(MATRIX)
	$(VENV)-4.5/bin/python -m pytest $(MATRIX)

# The add-on in a real Blender's window, by the mouse: needs a Blender, Xvfb, xdotool and ImageMagick (tests/gui/conftest.py).
test-gui: $(READY)
	RAUCA_BLENDER=$${RAUCA_BLENDER:-blender} $(VENV)/bin/python -m pytest tests/gui -x -v

# Lines of rauca_core that the tests run, in commands that they start too.
coverage: $(READY) $(MMDETECTION)
	$(VENV)/bin/python -m coverage run -m pytest $(PARALLEL)
	$(VENV)/bin/python -m coverage combine --quiet
	$(VENV)/bin/python -m coverage report --skip-covered --fail-under 90

lint: $(READY)
	$(VENV)/bin/ruff format --check .
	$(VENV)/bin/ruff check .
	$(VENV)/bin/mypy

# The documentation as a site, site/index.html; a broken link is an error.
docs: $(VENV)/.docs
	NO_MKDOCS_2_WARNING=1 $(VENV)/bin/mkdocs build --strict --quiet

# The README's pictures, from the demo's own results.
pictures: demo
	$(VENV)/bin/rauca report runs/demo --pictures docs/pictures

# The add-on as a zip that Blender installs from disk.
extension: $(READY)
	$(VENV)/bin/python tools/build_extension.py dist

# torch comes first and pinned, and stays named: torchvision's newest asks for a newer torch, which would replace it and
# bring gigabytes of CUDA libraries.
TORCH := torch==2.13.0
# Trackers of clips and the reference of their metrics, without what they ask for: it would replace NumPy and OpenCV.
TRACKERS := trackers==2.6.1 supervision==0.31.2 pydeprecate==0.14.0 defusedxml==0.7.1
TRACKERS += trackeval==1.3.0 tabulate==0.10.0
# The demo's part alone: a third of the files fewer, so that its first picture comes sooner.
$(DEMO): pyproject.toml
	@$(PYTHON) tools/system_libraries.py
	$(PYTHON) -m venv $(VENV)
	$(VENV)/bin/python -m pip install --quiet --no-compile $(TORCH)
	$(VENV)/bin/python -m pip install --quiet --no-compile $(TORCH) -e .[dataset,optimize,report]
	touch $(DEMO)

$(READY): $(DEMO)
	$(VENV)/bin/python -m pip install --quiet --no-compile $(TORCH) -e .[dataset,optimize,report,bench,slurm,detectors,dev]
	$(VENV)/bin/python -m pip install --quiet --no-compile --no-deps $(TRACKERS)
	touch $(READY)

# For tests/detect/test_mmdet_networks.py alone, in a folder of its own and without what it asks for: that would replace
# our OpenCV. mmcv-lite is mmcv without its operators, which take a quarter of an hour to compile. 47 MB.
$(MMDETECTION): $(READY)
	rm -rf $(@D)
	$(VENV)/bin/python -m pip install --quiet --no-compile --no-deps --target $(@D) mmdet==3.3.0 mmengine==0.10.7 mmcv-lite==2.1.0 \
		addict platformdirs shapely six termcolor terminaltables yapf
	touch $@

$(VENV)/.docs: $(READY)
	$(VENV)/bin/python -m pip install --quiet --no-compile $(TORCH) -e .[docs]
	touch $@

# bpy 4.5 was built against NumPy 1.
$(VENV)-4.5/.ready: pyproject.toml
	$(PYTHON) -m venv $(VENV)-4.5
	$(VENV)-4.5/bin/python -m pip install --quiet --no-compile $(TORCH)
	$(VENV)-4.5/bin/python -m pip install --quiet --no-compile $(TORCH) -e .[optimize,report,dev] xatlas trimesh bpy==4.5.15 'numpy<2'
	touch $@

clean:
	rm -rf $(VENV) $(VENV)-4.5 runs reports site
