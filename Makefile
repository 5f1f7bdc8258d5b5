# Both commands set everything up by themselves: Python ≥ 3.11, make and internet are enough.
#
#   make paper   the paper's three cases through LAMMPS, compared with theory: runs/paper/, figures and a table
#   make test    all tests, with the linter and the type checker
#
# Figures of the pages are cases, folders of analysis/cases with their runs, script and expected numbers. `granular-analysis
# cases` lists them with the minutes that each takes; `granular-analysis case NAME` runs one into runs/NAME and figures/.
# make GROUP runs those of the lines `GROUP: cases = ...` below, make figures those of README and of the theory pages.
#
# make gallery (the pictures of docs/gallery.md, by the commands on that page),
# make types (the type checker alone),
# make processors (the tests that depend on last digits, as on other processors; make test runs them there only),
# make stability (hard cases, and more members of what make test claims, a few minutes: docs/verification.md),
# make guards (how often a guard is wrong, of 261 random scenes, ten minutes: docs/verification.md),
# make ladders (how often a tolerance is missed, of 168 random scenes, and its cost, ten minutes: docs/verification.md),
# make mutants (each change of the source that a line of the verification manual names fails its test, five minutes:
# docs/verification.md),
# make witness (the network beside LAMMPS over the number of spheres, and its gradients, ten minutes:
# benchmarks/RESULTS.md),
# make gpu (the network on a card of NVIDIA, its tests and its speed, under five minutes; skipped where there is none),
# make bench (our run beside other codes, with the error of each; with BESIDE=COMMIT also beside an earlier commit of this
# repository), make scale (cost up to a million spheres),
# make docs (the documentation site, into site/), make rooms (the drawing of docs/architecture.md),
# make notebook (the tutorials, executed, into docs/tutorial*.ipynb; two minutes),
# make versioned-docs (the site of this version beside those of others, onto the branch gh-pages: RELEASING.md),
# make engines (sweeps that are cancelled, preempted and killed on a Slurm of this machine, where one can be started),
# make wheel (what pip installs, into dist/), make hooks, packages, floors, readers, tested-docs (of continuous integration:
# pre-commit, the packages installed alone, the oldest versions of what they need, programs that a run is exported for, the
# site),
# make decks (rewrites the committed decks of lammps_inputs), make reference (all keys, cases and help, into docs), make clean.

PYTHON ?= python3
BIN = .venv/bin
# Matrices are small here: threads of OpenBLAS take a quarter of the processor time and give nothing
export OPENBLAS_NUM_THREADS ?= 1
# Bytecode that is not kept is compiled again by each command, which takes half as long as its start
unexport PYTHONDONTWRITEBYTECODE

GROUPS = spectrum dispersion waves quiet scattering disorder impact published pull-off onset adhesion cost

.PHONY: $(GROUPS) paper figures gallery test types processors stability guards ladders mutants witness gpu bench scale decks reference docs \
    tested-docs versioned-docs notebook rooms engines hooks wheel packages floors readers clean

spectrum: cases = spectrum
dispersion: cases = dispersion
waves: cases = oblique standing driven sheets sources
quiet: cases = quiet
scattering: cases = scatter behind
disorder: cases = disorder defects imaging
impact: cases = fronts solitary
published: cases = dimers refraction
pull-off: cases = pull_off
onset: cases = onset
adhesion: cases = adhesion_laws
cost: cases = accuracy
$(GROUPS): .venv/ready
	$(BIN)/granular-analysis case $(cases)

PAPER = tr_nonresonant tr_resonant tr_antiresonant

paper: .venv/ready
	$(BIN)/granular-analysis case figure2 figure3 --runs runs/paper --figures runs/paper
	$(BIN)/granular-analysis compare $(PAPER:%=runs/paper/%) --json runs/paper/compare.json > runs/paper/compare.txt
	cat runs/paper/compare.txt

# Into the repository. The bytes of a PNG depend on the versions of matplotlib and FreeType, and on last digits
figures: paper
	cp runs/paper/figure2.png runs/paper/figure3.png figures/
	$(BIN)/granular-analysis case effects map mixing

witness: .venv/ready
	$(BIN)/python -m benchmarks.network
	$(BIN)/python -m benchmarks.steps
	$(BIN)/python -m benchmarks.gradients

gpu: .venv/ready
	if command -v nvidia-smi > /dev/null; then \
	    $(BIN)/python -m pip install --quiet 'jax[cuda12]' && \
	    $(BIN)/pytest tests/theory/test_network_traced.py tests/theory/test_network_gradient.py && \
	    $(BIN)/python -m benchmarks.device --demand gpu --largest 10000000 && \
	    $(BIN)/python -m benchmarks.gradients --repeats 1; \
	else echo "skipped: no card of NVIDIA is found here"; fi

gallery: .venv/ready
	mkdir -p runs && sed -n '/^```toml/,/^```/{/^```/!p}' README.md > runs/first.toml
	$(BIN)/granular-lmp run runs/first.toml -o runs/first --force && $(BIN)/granular-lmp view runs/first -o figures/gallery/first.png
	sed -n '/^```console/,/^```/{/^```/!s/^\($$ \)\{0,1\}//p}' docs/gallery.md | PATH="$(CURDIR)/$(BIN):$$PATH" sh -ex

test: .venv/ready
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(MAKE) --no-print-directory --jobs=2 types processors
	$(BIN)/pytest --numprocesses=auto --dist=loadfile -m "not rounding and not more"

# It is one process, to which those of `processors`, being nice, leave a core
types: .venv/ready
	$(BIN)/mypy

processors: .venv/ready
	nice $(BIN)/python -m tests.processors

stability: .venv/ready
	$(BIN)/python -m tests.hard.report -o docs/stability.csv
	$(BIN)/pytest tests/hard/test_bad_input.py tests/hard/test_broken_decks.py --hypothesis-profile=thorough
	$(BIN)/pytest --numprocesses=auto --dist=loadfile -m more

guards: .venv/ready
	$(BIN)/python -m tests.hard.guard_study --write docs/guards.csv

ladders: .venv/ready
	$(BIN)/python -m tests.hard.ladder_study --write docs/ladders.csv

mutants: .venv/ready
	$(BIN)/python -m tests.manual

bench: .venv/ready
	$(BIN)/python -m benchmarks -o figures/bench.png
	$(if $(BESIDE),$(BIN)/python -m benchmarks.earlier $(BESIDE))

scale: .venv/ready
	$(BIN)/python -m benchmarks.scale

# What readers without the site find of the sources: docs/scene.csv, cases.csv and commands.txt
reference: .venv/ready
	$(BIN)/python docs/generated.py

decks: .venv/ready
	for scene in lammps_inputs/*/scene.toml lammps_inputs/impacts/*/scene.toml; do $(BIN)/granular-lmp build $$scene -o $$(dirname $$scene) --force || exit 1; done

# A warning is an error: a link, an anchor or a page of the navigation that is not there. The variable silences a notice of
# the theme's vendor about another program
docs: .venv/docs-ready
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

tested-docs: docs
	$(BIN)/pytest tests/house/test_site.py tests/house/test_tutorial.py tests/house/test_release.py

# Each version keeps its folder; SITE=dev is that of the default branch; PUSH=--push sends gh-pages to its origin. The front
# door leads to the latest release
VERSION := $(shell sed -n 's/^__version__ = "\(.*\)"/\1/p' granular_lmp/version.py)
SITE ?= $(VERSION) latest
PUSH ?=

versioned-docs: .venv/docs-ready
	NO_MKDOCS_2_WARNING=1 $(BIN)/mike deploy $(PUSH) --update-aliases $(SITE)
	$(if $(filter latest,$(SITE)),$(BIN)/mike set-default $(PUSH) --allow-empty latest)

notebook: .venv/docs-ready
	$(BIN)/python docs/tutorial_notebook.py

engines: .venv/ready
	$(BIN)/python -m pip install --quiet --editable '.[engines]'
	$(BIN)/pytest -v tests/engines

# What `pre-commit install` has done before each commit; its hooks are the linter and the type checker of .venv
hooks: .venv/ready
	$(BIN)/python -m pip install --quiet pre-commit
	$(BIN)/pre-commit run --all-files --show-diff-on-failure

wheel:
	$(PYTHON) -m pip wheel --quiet --no-deps --wheel-dir dist .

# Installed alone, in an empty folder, all that the pages say; twine reads the packages as an index will
KIND ?= whl
packages:
	$(PYTHON) -m venv .venv-packages
	.venv-packages/bin/python -m pip install --quiet build twine
	PATH="$(CURDIR)/.venv-packages/bin:$$PATH" .ci/wheel $(KIND)
	.venv-packages/bin/python -m build --outdir dist && .venv-packages/bin/twine check --strict dist/*

FLOORS = cli/test_cli.py lammps/test_datafile.py lammps/test_deck.py runs/test_export.py house/test_floors.py runs/test_launch.py crystal/test_modes.py crystal/test_packing.py \
    runs/test_particles.py scene/test_scene.py cases/test_sheets.py cases/test_spectrum.py studies/test_sweep.py plot/test_view.py crystal/test_wave.py house/test_wheel.py
floors:
	$(PYTHON) -m venv .venv-floors
	.venv-floors/bin/python -m pip install --quiet --constraint .ci/floors.txt --editable '.[test]'
	.venv-floors/bin/pytest --numprocesses=auto --dist=loadfile $(FLOORS:%=tests/%)

readers: .venv/ready
	$(BIN)/python -m pip install --quiet MDAnalysis
	$(BIN)/pytest tests/runs/test_export.py

rooms: .venv/ready
	$(BIN)/python docs/rooms.py

# Marker files, written last: an interrupted installation is repeated. pip compiles on one core, tests of others too; what
# does not compile belongs to no module that is imported
.venv/docs-ready: .venv/ready
	$(BIN)/python -m pip install --quiet --editable '.[docs]'
	touch $@

.venv/ready: pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit("Python 3.11 or later is needed: make PYTHON=python3.12 ...") if sys.version_info < (3, 11) else None'
	test -x $(BIN)/python || $(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --no-compile --editable '.[test]'
	-$(BIN)/python -m compileall -q -j 0 -x '/tests/' .venv/lib granular_lmp analysis/granular_analysis
	$(BIN)/granular-lmp build-kernel || echo "without the kernel, which makes runs faster, all else works"
	touch $@

clean:
	rm -rf runs/paper $(patsubst analysis/cases/%/case.toml,runs/%,$(wildcard analysis/cases/*/case.toml)) build dist site .venv .venv-packages .venv-floors .pytest_cache .mypy_cache .ruff_cache
