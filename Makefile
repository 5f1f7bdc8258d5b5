# Both commands set everything up by themselves: Python ≥ 3.11, make and internet are enough.
#
#   make paper   the paper's three cases through LAMMPS, compared with theory: figures/ and a table
#   make test    all tests, with the linter and the type checker
#
# Also: make figures (the others of the docs), make decks (rewrites the committed decks of lammps_inputs), make clean;
# make bench (our run beside other codes, with the error of each), make scale (cost up to a million spheres).

PYTHON ?= python3
BIN = .venv/bin
CASES = tr_nonresonant tr_resonant tr_antiresonant
# A quarter of the scenes' own step: what is left of the error is the theory's, not the integrator's.
STEP = 0.0125
RUNS = $(CASES:%=runs/paper/%)

.PHONY: paper figures test bench scale decks clean

paper: .venv/ready
	for case in $(CASES); do \
	    $(BIN)/granular-lmp run $$case --set time.timestep=$(STEP) -o runs/paper/$$case --force || exit 1; done
	$(BIN)/python -m analysis.compare $(RUNS) --json runs/paper/compare.json > runs/paper/compare.txt && cat runs/paper/compare.txt
	$(BIN)/python -m analysis.figure2 -o figures/figure2.png
	$(BIN)/python -m analysis.figure3 $(RUNS) -o figures/figure3.png

figures: .venv/ready
	$(BIN)/python -m analysis.convergence -o figures/convergence.png
	$(BIN)/python -m analysis.laws -o figures/laws.png
	$(BIN)/python -m analysis.map -o figures/map.png

test: .venv/ready
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/pytest

bench: .venv/ready
	$(BIN)/python -m benchmarks

scale: .venv/ready
	$(BIN)/python -m benchmarks.scale

decks: .venv/ready
	for scene in lammps_inputs/*/scene.toml; do $(BIN)/granular-lmp build $$scene -o $$(dirname $$scene) --force || exit 1; done

# A marker file, written last: an interrupted installation is repeated.
.venv/ready: pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit("Python 3.11 or later is needed: make PYTHON=python3.12 ...") if sys.version_info < (3, 11) else None'
	test -x $(BIN)/python || $(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --editable '.[test]'
	touch $@

clean:
	rm -rf runs/paper build dist .venv .pytest_cache .mypy_cache .ruff_cache
