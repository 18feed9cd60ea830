# Two commands do everything on a fresh machine: `make demo` and `make test`.
PYTHON ?= $(shell command -v python3.11 || command -v python3)
VENV := .venv
READY := $(VENV)/.ready

.PHONY: demo test lint pictures extension kernels clean

demo: $(READY)
	$(VENV)/bin/rauca demo

test: $(READY)
	$(VENV)/bin/python -m pytest

lint: $(READY)
	$(VENV)/bin/ruff format --check .
	$(VENV)/bin/ruff check .
	$(VENV)/bin/mypy

# The README's pictures, from the demo's own results.
pictures: demo
	$(VENV)/bin/rauca report runs/demo --pictures docs/pictures

# The add-on as a zip that Blender installs from disk.
extension: $(READY)
	$(VENV)/bin/python pipelines/build_extension.py dist

# torch comes first and pinned: asked for later, by another package, it would bring gigabytes of CUDA libraries.
$(READY): pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(VENV)/bin/python -m pip install --quiet torch==2.13.0
	$(VENV)/bin/python -m pip install --quiet -e .[blender,bench,dev]
	touch $(READY)

# Compiled kernels do not notice changes in the files they call; see CONTRIBUTING.md.
kernels:
	find rauca_core benchmarks -name '*.nb[ci]' -delete

clean:
	rm -rf $(VENV) runs reports
