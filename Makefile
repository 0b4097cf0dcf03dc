# `make film` makes the film, `make test` tests the project; each sets up what it needs first.
# A .venv that is there keeps its Python; another Python needs another checkout, or `rm -r .venv`.
PYTHON ?= $(if $(realpath .venv/bin/python),.venv/bin/python,python3)
BIN := .venv/bin
CORES ?= $(shell nproc 2>/dev/null || sysctl -n hw.ncpu)

.PHONY: film showreel test quick soak bounds removable bench blender blender-extension check docs reference figures pictures wheel setup lock clean same-python
.DELETE_ON_ERROR:

film: .venv/ready
	$(BIN)/flowsculpt -j $(CORES) film

# Every shot of the gallery in two minutes, with cards, dissolves and music.
showreel: .venv/ready
	$(BIN)/flowsculpt -j $(CORES) film showreel

# Files of tests are given out in their order: by their counts of tests, long ones would come last.
test: .venv/ready-dev check
	$(BIN)/python -m pytest --complete -m "not soak" -n 2 --dist loadfile --no-loadscope-reorder

# Style, and the tests of every package that need no renderer and take half a second at most: about a minute.
quick: .venv/ready-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/python -m pytest -q -m "not (soak or renderer or slow)" -n 2 --dist loadfile --no-loadscope-reorder

# Long runs, and all other tests with new examples; then tests with other versions of packages, and without plug-ins.
soak: .venv/ready-dev
	$(BIN)/python -m pytest --hypothesis-profile=new --no-forks
	$(MAKE) bounds removable

# The tests with the lowest versions of packages that pyproject.toml allows, and with the newest there are.
bounds: .venv/ready-dev
	$(BIN)/python tests/checks/dependency_bounds.py lowest-direct
	$(BIN)/python tests/checks/dependency_bounds.py highest

# What works without each plug-in, and without ten pairs of them: help, a film, the quick tests, the docs. Hours.
removable: .venv/ready-dev
	$(BIN)/python tests/checks/removable_plugins.py

check: .venv/ready-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/snakefmt --check Snakefile
	$(BIN)/python tests/checks/type_stubs.py
	$(BIN)/mypy
	$(BIN)/python tests/checks/import_layers.py --no-logo
	$(BIN)/codespell

bench: .venv/ready-bench
	$(BIN)/python -m benchmarks

# The documentation as a site: docs/site/index.html.
docs: .venv/ready-dev
	$(BIN)/python -m sphinx -W --keep-going -q docs docs/site

# The pages of the docs that come from the code: settings of shot files, commands and their options,
# and the names that plug-ins may import.
reference: .venv/ready-dev
	test ! -d pipeline/plugins/authoring || $(BIN)/python docs/settings.py # by the schemas of that plug-in
	$(BIN)/python docs/commands.py
	$(BIN)/python docs/plugin_names.py

# The figures of the docs, by the scripts in examples/.
figures: .venv/ready-dev
	$(BIN)/python -m examples
	$(BIN)/python -m examples flows

# All pictures of the docs: the figures, the README's moving one from the draft film, a still of every shot.
pictures: figures film
	$(BIN)/python docs/pictures/make.py
	$(BIN)/python docs/pictures/gallery.py
	$(BIN)/python docs/pictures/stills.py
	$(BIN)/python docs/pictures/sets.py
	$(BIN)/python docs/pictures/looks.py
	$(BIN)/python docs/pictures/pigments.py
	$(BIN)/python docs/pictures/sheets.py
	$(BIN)/python docs/pictures/generations.py
	PYTHONPATH=. $(BIN)/python docs/pictures/web_page.py
	PYTHONPATH=. $(BIN)/python docs/pictures/review.py

# A wheel with kernels compiled for these levels of x86-64, which this machine must be able to run: dist/*.whl.
LEVELS := x86-64-v3
wheel: .venv/ready
	rm -rf dist/cache render/compiled
	for level in $(LEVELS); do \
		XDG_CACHE_HOME=$(CURDIR)/dist/cache FLOWSCULPT_CPU=$$level $(BIN)/flowsculpt -j $(CORES) doctor --prepare && \
		ls -d dist/cache/flowsculpt/kernels/*-$$level >/dev/null || exit 4; \
	done
	find dist/cache -name '*.inner' -delete
	mv dist/cache/flowsculpt/kernels render/compiled
	$(BIN)/python -m pip wheel --quiet --no-deps --no-build-isolation --wheel-dir dist .
	rm -rf dist/cache render/compiled

# All kernels now; a film goes without some, and has them compiled in the background.
setup: .venv/ready
	@$(BIN)/flowsculpt -j $(CORES) doctor --prepare

# The pip of old Pythons takes 6 CPU seconds more to find packages; the one that $(PYTHON) has, if any, installs ours,
# because a venv's own takes 2 seconds to make. What films do not need is compiled when it is first imported.
UNCOMPILED := /tests?/|/numba/(cuda|misc|pycc|testing)/|/numpy/(distutils|f2py|ma|testing)/|/pipeline/plugins/[^/]+/(?!__init__)
UNCOMPILED := $(UNCOMPILED)|/pydantic/(deprecated|experimental|v1)/|/sqlalchemy/(dialects|ext|testing)/|/PIL/\w+ImagePlugin
UNCOMPILED := $(UNCOMPILED)|/(docutils|fontTools|hatchling|matplotlib|mpl_toolkits|pip|pkg_resources|pygments|setuptools)/
UNCOMPILED := $(UNCOMPILED)|/(av|contourpy|fileseq|fsspec|git|gitdb|nbformat|opentimelineio|pyparsing|shapely|traitlets|trimesh)/
UNCOMPILED := $(UNCOMPILED)|/(cffi|dateutil|fastjsonschema|humanfriendly|imageio/plugins|jsonschema|jupyter_core|packaging|pathspec)/
UNCOMPILED := $(UNCOMPILED)|/(cftime|cmocean|donfig|google_crc32c|h5netcdf|h5py|numcodecs|pandas|scipy|xarray|zarr)/
UNCOMPILED := $(UNCOMPILED)|/(pluggy|pycparser|referencing|rich/_unicode_data|smmap|tomlkit|trove_classifiers)/
PIP := --quiet --no-compile --require-hashes -r requirements-pip.lock
# Each of two processes installs every other package: one alone unpacks 1.2 GB on one core.
LOCKED := --quiet --no-compile --no-deps --require-hashes

.venv/ready: requirements-pip.lock requirements.lock pyproject.toml | same-python
	@$(PYTHON) -c 'import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 14))' || \
		{ echo "flowsculpt's lock supports Python 3.11, 3.12 and 3.13, and $(PYTHON) is none of them (for 3.14," \
		"immutables, which Snakemake needs, and opentimelineio have no wheels);" \
		"point make at one: make PYTHON=python3.12 film" >&2; exit 4; }
	@$(PYTHON) -c 'import ensurepip' 2>/dev/null || \
		{ echo "flowsculpt needs Python's venv module: apt-get install python3-venv" >&2; exit 4; }
	@echo "Setting up .venv, once. 1 of 2: packages (1.2 GB; about a minute if pip has them already)"
	@$(PYTHON) -m venv --without-pip .venv
	@$(PYTHON) -m pip --python $(BIN)/python install $(PIP) 2>/dev/null || \
		{ $(BIN)/python -m ensurepip >/dev/null && $(BIN)/python -m pip install $(PIP); }
	@for half in 0 1; do awk "/^[^ #]/ { n++ } n % 2 == $$half" requirements.lock >.venv/$$half.lock; done; \
		$(BIN)/python -m pip install $(LOCKED) -r .venv/0.lock & $(BIN)/python -m pip install $(LOCKED) -r .venv/1.lock; \
		code=$$?; wait $$! && exit $$code
	@$(BIN)/python -m pip install --quiet --no-compile --no-deps --no-build-isolation -e . & \
		$(BIN)/python -m compileall -q -j $(CORES) -x '$(UNCOMPILED)' .venv/lib flowsculpt pipeline render; \
		code=$$?; wait $$! && exit $$code
	@echo "2 of 2: the renderer, and the kernels of films, on all cores (half a minute on two)"
	@$(BIN)/flowsculpt -j $(CORES) doctor --prepare --background
	@touch $@

same-python:
	@test ! -L $(BIN)/python || test $(PYTHON) = $(BIN)/python || { \
		old=$$($(BIN)/python -V 2>/dev/null); new=$$($(PYTHON) -V 2>/dev/null); test "$${old%.*}" = "$${new%.*}" || \
		{ echo ".venv has $${old:-a Python that is gone}, and $(PYTHON) is $${new:-no Python};" \
		"to set up another, remove it: rm -r .venv" >&2; exit 4; }; }

.venv/ready-dev: .venv/ready requirements-dev.lock
	$(BIN)/python -m pip install --quiet --require-hashes -r requirements-dev.lock
	@$(BIN)/flowsculpt -j $(CORES) doctor --prepare
	-@$(BIN)/python tests/production/farm/slurm.py fetch
	@touch $@

# The extension for Blender 4.5 and later: dist/flowsculpt-blender-*.zip.
blender-extension:
	$(PYTHON) blender/build_extension.py dist

# Blender as a module, 820 MB, which there is for Python 3.11 and 3.13: for the tests of the extension, of its compositor, of what it
# reads of exported shots, and the comparison with Cycles.
blender: .venv/ready-cycles
	$(BIN)/python -m pytest tests/blender tests/render/test_blender.py tests/plugins/interchange/test_blender.py tests/plugins/fields/test_vdb_recipes.py

.venv/ready-cycles: .venv/ready-dev benchmarks/requirements-cycles.txt
	rm -rf .venv/cycles
	$(BIN)/python -m pip install --quiet --no-deps --target .venv/cycles -r benchmarks/requirements-cycles.txt
	@touch $@

.venv/ready-bench: .venv/ready benchmarks/requirements.txt
	$(BIN)/python -m pip install --quiet --no-deps --target .venv/peers -r benchmarks/requirements.txt
	@touch $@

# Versions of packages are part of keys: `fewest` takes one of each for all Pythons, not the newest for each.
lock:
	echo pip | uv pip compile $(LOCK) - -o requirements-pip.lock
	uv pip compile $(LOCK) --extra film --extra models --extra fields --extra perform --group build pyproject.toml -o requirements.lock
	uv pip compile $(LOCK) --extra film --extra models --extra fields --extra perform --group build --group dev pyproject.toml -c requirements.lock -o requirements-dev.lock
LOCK := --quiet --upgrade --python-version 3.11 --universal --fork-strategy fewest --generate-hashes --no-emit-index-url --no-emit-find-links --no-annotate --custom-compile-command "make lock"

clean:
	rm -rf renders .flowsculpt .snakemake
